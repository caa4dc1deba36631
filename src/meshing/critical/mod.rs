//! Critical curves: where direct light jumps or bends on surfaces, as line segments on their triangles.
//!
//! Discontinuity meshing (Heckbert, "Discontinuity meshing for radiosity", 1992; Lischinski, Tampieri, Greenberg,
//! "Discontinuity meshing for accurate radiosity", 1992) cuts receivers along them. A *wedge* is a part of a plane that
//! light passes through past an occluder: VE wedges hold a vertex of the emitter and a silhouette edge, EV wedges an
//! edge of the emitter and a vertex of a silhouette (Drettakis, Fiume, "A fast shadow algorithm for area light sources
//! using backprojection", 1994). Where a wedge meets a receiver, light jumps (D0: emitters without size, and contacts),
//! or its slope does (D1), or its curvature (D2). The plane of a flat emitter is a wedge without an occluder.
//!
//! Wedges are not intersected with all of the scene: rays along them find which triangles they land on, and what hides
//! them; the segments themselves are intersections of planes. Cost: a few rays a wedge, and so about a second a hundred
//! thousand wedges.
//!
//! Left out: EEE surfaces, of three edges, which are curved; edges whose shadows are shorter than asked for, as those
//! of finely tessellated round things; the sky, and portals to skies with pictures; cut-out and transmitting occluders;
//! receivers that block nothing, as rays pass through them.

mod chain;
mod contact;
mod emitter;
mod horizon;
mod occluder;
mod shadow;
mod wedge;

use crate::light::Lights;
use crate::scene::Scene;
use crate::trace::Tracer;
pub use chain::soften;
use contact::contacts;
use emitter::{emitters, mean_light};
use glam::DVec3;
use horizon::horizons;
use occluder::Occluders;
use shadow::shadows;

/// A piece of a critical curve on one triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CriticalLine {
    /// The surface that light falls on.
    pub surface: u32,
    /// The triangle of its mesh.
    pub triangle: u32,
    /// Its ends in world space [m], in the plane of the triangle and inside it within rounding.
    pub ends: [DVec3; 2],
    pub order: Order,
    /// How much illuminance changes from one side of the shadow's border to the other, about [lx]; of a contact, the
    /// mean light of the scene.
    pub contrast: f64,
    /// Width of the penumbra that it belongs to [m], or over which light changes by the contrast; 0 of jumps.
    pub width: f64,
}

/// The lowest derivative of light that jumps across a line: none, the first, the second.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Order {
    /// D0: light itself: hard shadows and contacts.
    Jump,
    /// D1: its slope: the borders of umbrae and penumbrae, in planes that have the emitter or the occluder on one side.
    Bend,
    /// D2: its curvature: other critical planes, inside penumbrae.
    Curve,
}

/// What lines are looked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CriticalParams {
    /// Shadows of edges shorter than this are left out, and lines shorter than a fifth of it [m]; more than 0.
    pub length: f64,
    /// Penumbrae narrower than this are a jump along their middle [m].
    pub width: f64,
    /// Surfaces nearer than this touch [m].
    pub contact: f64,
    /// Shadows that change the light by less than this share of the scene's mean direct light are left out.
    pub contrast: f64,
    /// Lines inside penumbrae are looked for, too.
    pub curves: bool,
    /// The most lines; those that show least are left out.
    pub lines: usize,
}

impl CriticalParams {
    /// For a lightmap of `density` [texels per metre].
    pub fn of_density(density: f64) -> Self {
        let texel = 1.0 / density;
        Self { length: texel, width: 0.5 * texel, contact: 0.05 * texel, contrast: 0.02, curves: true, lines: 30_000 }
    }
}

impl CriticalLine {
    /// Those on one surface, of lines that are sorted by surface, as [`critical_lines`] gives them.
    pub fn of_surface(lines: &[Self], surface: usize) -> &[Self] {
        let first = lines.partition_point(|line| (line.surface as usize) < surface);
        let count = lines[first..].partition_point(|line| line.surface as usize == surface);
        &lines[first..first + count]
    }

    /// Its length [m].
    pub fn length(&self) -> f64 {
        self.ends[0].distance(self.ends[1])
    }

    /// How much it shows: the larger the sooner it is kept.
    fn rank(&self) -> f64 {
        let order = match self.order {
            Order::Jump => 1.0,
            Order::Bend => 0.5,
            Order::Curve => 0.1,
        };
        self.contrast * self.length() * order
    }
}

/// The critical lines of a scene under its lights, by surface, triangle and how much they show. The same at any number
/// of threads.
pub fn critical_lines(scene: &Scene, tracer: &Tracer, lights: &Lights, params: &CriticalParams) -> Vec<CriticalLine> {
    let occluders = Occluders::new(scene, tracer);
    let emitters = emitters(scene, lights);
    let stage = Stage { scene, tracer, lights, occluders: &occluders, params };
    let (emitters, mean) = mean_light(&stage, emitters);
    let mut lines = contacts(&stage, mean);
    lines.extend(shadows(&stage, &emitters, params.contrast * mean));
    lines.extend(horizons(&stage, &emitters, params.contrast * mean));
    chain::chain(lines, params, scene)
}

/// All that lines depend on.
#[derive(Clone, Copy)]
struct Stage<'a> {
    scene: &'a Scene,
    tracer: &'a Tracer,
    lights: &'a Lights,
    occluders: &'a Occluders,
    params: &'a CriticalParams,
}
