//! Vertex colours that hold the light: values at the vertices of meshes, and meshes that follow the light.
//!
//! The light is that of the finished pages, sampled at texels ([`sample`]). Values are fitted to it by least squares ([`fit`]); where
//! the mesh can't hold it, triangles are cut ([`refine`]), along the critical curves of shadows first where that is asked for
//! ([`critical`], [`constrain`]), and vertices that it doesn't need go again ([`coarsen`]).
//!
//! A mesh that is refined keeps its triangles: each is cut into pieces, and a new vertex is a place in a triangle of the source,
//! so that whatever vertices hold (normals, UVs, weights of skins, morph targets) can be blended there.

mod coarsen;
pub mod constrain;
pub mod critical;
mod doubt;
pub mod fine;
pub mod fit;
mod page;
pub mod refine;
pub mod sample;
pub mod weights;

use crate::color::Rgb;
use crate::error::Result;
use crate::light::Lights;
use crate::progress::Progress;
use crate::scene::{BakeMode, Scene, SurfaceOrigin};
use crate::trace::Tracer;
use coarsen::coarsen;
use constrain::{ConstrainParams, constrain};
use critical::{CriticalLine, CriticalParams, Order, critical_lines, soften};
use fine::FineMesh;
use fit::relative_error;
use rayon::prelude::*;
use refine::{Work, refine};
pub use sample::{LEAST_LEVEL, Source};
use std::collections::BTreeSet;
pub use weights::Weights;

/// The light at the vertices of all surfaces.
#[derive(Clone, Debug, Default)]
pub struct VertexLight {
    /// By surface; empty for those that don't receive, and for those that show the vertices of another.
    pub surfaces: Vec<LitMesh>,
}

/// A surface's mesh with light at its vertices.
#[derive(Clone, Debug, Default)]
pub struct LitMesh {
    /// The pieces of the mesh's triangles, in the order of those; each triangle has one piece at least.
    pub triangles: Vec<LitTriangle>,
}

/// A triangle of the source's mesh, or a piece of one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LitTriangle {
    /// The triangle of the mesh that this is a piece of.
    pub source: u32,
    /// Where its corners lie in that triangle; its winding is that triangle's.
    pub corners: [Weights; 3],
    /// The lightmap's quantity at its corners.
    pub values: [Rgb; 3],
}

impl LitMesh {
    /// The mesh as it was given, with `values` at the corners of its triangles.
    pub fn given(values: impl IntoIterator<Item = [Rgb; 3]>) -> Self {
        let whole = |(source, values)| LitTriangle { source, corners: Weights::CORNERS, values };
        Self { triangles: (0..).zip(values).map(whole).collect() }
    }

    /// True where no triangle was cut.
    pub fn is_given(&self) -> bool {
        self.triangles.iter().all(|t| t.corners == Weights::CORNERS)
    }
}

/// How meshes follow the light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MeshMode {
    /// Not at all.
    #[default]
    Given,
    /// Triangles are cut where values between vertices miss the light.
    Adaptive,
    /// The same, after triangles were cut along the critical curves of shadows and contacts.
    Discontinuity,
}

/// How the light gets to vertices.
#[derive(Clone, Copy, Debug)]
pub struct MeshParams {
    pub mode: MeshMode,
    /// The error that is asked for: relative to the luminance there, or to [`LEAST_LEVEL`] of the mean where that is more, of the
    /// channel that is farthest off.
    pub error: f64,
    /// Triangles over all surfaces at most; none: as many as the error takes.
    pub max_triangles: Option<u64>,
}

/// How well the light at vertices holds the light of texels.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub struct VertexReport {
    pub mode: MeshMode,
    /// Triangles of the surfaces that receive light, as given, and as written: those that files hold, so that instances that share
    /// vertices count once.
    pub given_triangles: u64,
    pub triangles: u64,
    /// The error that was asked for [%]: see [`MeshParams::error`].
    pub error: f64,
    /// The share of the surfaces' area that is within it [%], and the error within which 95 % of it are [%].
    pub within: f64,
    pub p95: f64,
}

/// Makes the light at vertices.
///
/// # Errors
/// `Cancelled`.
pub fn vertex_light(
    source: &Source,
    params: &MeshParams,
    progress: &dyn Progress,
) -> Result<(VertexLight, VertexReport)> {
    let surfaces = &source.scene.surfaces;
    progress.begin("vertices", 0);
    let mut meshes = vec![LitMesh::default(); surfaces.len()];
    let mut errors = Errors::default();
    let mut given = 0;
    let mut finish = |work: &Work| {
        meshes[work.surface] = work.mesh();
        errors.merge(&Errors::of(work, source.mean));
    };
    let receiving = written(source.scene);
    if params.mode == MeshMode::Given {
        // A few surfaces at a time: samples take as much memory as pages.
        for some in receiving.chunks(64) {
            progress.check()?;
            let of_surface = |s: &usize| {
                let mut work = Work::new(source, *s, FineMesh::new(source.scene, *s));
                work.fit();
                (*s, work.mesh(), Errors::of(&work, source.mean))
            };
            let done: Vec<_> = some.par_iter().map(of_surface).collect();
            for (s, mesh, of_mesh) in done {
                given += mesh.triangles.len() as u64;
                meshes[s] = mesh;
                errors.merge(&of_mesh);
            }
        }
    } else {
        given = receiving.iter().map(|s| source.scene.meshes[surfaces[*s].mesh].triangles.len() as u64).sum();
        let works = cut(&receiving, source, params, progress)?;
        works.iter().for_each(&mut finish);
    }
    let triangles = meshes.iter().map(|m| m.triangles.len() as u64).sum();
    let (within, p95) = (100.0 * errors.share_below(params.error), 100.0 * errors.quantile(0.95));
    let error = 100.0 * params.error;
    let report = VertexReport { mode: params.mode, given_triangles: given, triangles, error, within, p95 };
    Ok((VertexLight { surfaces: meshes }, report))
}

/// The meshes of the surfaces `receiving`, cut along the light. Where jumps would take more triangles than there may be, those that
/// show least become bends.
fn cut(receiving: &[usize], source: &Source, params: &MeshParams, progress: &dyn Progress) -> Result<Vec<Work>> {
    let mut lines = if params.mode == MeshMode::Discontinuity { lines(source) } else { Vec::new() };
    let triangles = |s: usize| source.scene.meshes[source.scene.surfaces[s].mesh].triangles.len();
    let given: u64 = receiving.iter().map(|s| triangles(*s) as u64).sum();
    let room = params.max_triangles.map(|most| (most.saturating_sub(given) as f64 * ROOM_OF_JUMPS) as u64);
    loop {
        progress.check()?;
        let jumps = lines.iter().filter(|line| line.order == Order::Jump).count();
        let fine: Vec<FineMesh> = receiving.par_iter().map(|s| drawn(source, *s, &lines)).collect();
        let least: u64 = receiving.iter().zip(&fine).map(|(s, fine)| fine.least_triangles(triangles(*s))).sum();
        if jumps == 0 || room.is_none_or(|room| least - given <= room) {
            let start = |(s, fine): (&usize, FineMesh)| Work::new(source, *s, fine);
            let mut works: Vec<Work> = receiving.par_iter().zip(fine).map(start).collect();
            follow(&mut works, source, params, progress)?;
            let count: u64 = works.iter().map(|w| w.fine.pieces.len() as u64).sum();
            if lines.is_empty() || params.max_triangles.is_none_or(|most| count <= most) {
                return Ok(works);
            }
        }
        match jumps {
            0 => lines.clear(),
            _ => soften(&mut lines, jumps / 2),
        }
    }
}

/// The mesh of surface `surface`, cut along its lines.
fn drawn(source: &Source, surface: usize, lines: &[CriticalLine]) -> FineMesh {
    let mut fine = FineMesh::new(source.scene, surface);
    let density = f64::from(source.atlas.surface_density(source.scene, surface));
    let own = CriticalLine::of_surface(lines, surface);
    if density > 0.0 && !own.is_empty() {
        constrain(&mut fine, own, &ConstrainParams::of_density(density));
    }
    fine
}

/// The surfaces that receive light and whose vertices a file holds. Instances of a glTF node share theirs: the first that receives
/// speaks for all.
fn written(scene: &Scene) -> Vec<usize> {
    let mut nodes = BTreeSet::new();
    let is_own = |s: &usize| {
        let surface = &scene.surfaces[*s];
        let is_first = match surface.origin {
            SurfaceOrigin::GltfNode(node) if surface.role.receives => nodes.insert(node),
            _ => true,
        };
        surface.role.receives && is_first
    };
    (0..scene.surfaces.len()).filter(is_own).collect()
}

/// The critical lines of what is baked.
fn lines(source: &Source) -> Vec<CriticalLine> {
    let scene = source.scene;
    // Direct light that the engine adds has its shadows there.
    let lights = Lights::of(scene, |shining| shining.contribution(scene).mode() == BakeMode::Baked);
    let params = CriticalParams::of_density(f64::from(source.atlas.density));
    critical_lines(scene, &Tracer::new(scene), &lights, &params)
}

/// The part of the triangles that may be added that jumps may take; the rest go where the light needs them.
const ROOM_OF_JUMPS: f64 = 0.75;
/// Turns of cutting and taking out.
const TURNS: usize = 2;
/// The part of the triangles allowed that a turn leaves, so that the next one has some to put where they are needed more.
const LEFT: f64 = 0.85;
/// The share of the area whose error may be larger than asked, of all and of each piece to begin with.
const SHARE: f64 = 0.05;
/// How often that of each piece is halved where that of all is too much.
const TRIES: i32 = 3;

/// Cuts the meshes along the light, and takes out what it doesn't need.
fn follow(works: &mut [Work], source: &Source, params: &MeshParams, progress: &dyn Progress) -> Result<()> {
    let some = params.max_triangles.map(|most| (most as f64 * LEFT) as u64);
    for _ in 0..TURNS {
        refine(works, source, params, SHARE, progress)?;
        coarsen(works, source, params, some, progress)?;
    }
    for k in 0..TRIES {
        refine(works, source, params, SHARE * 0.5f64.powi(k), progress)?;
        let mut errors = Errors::default();
        works.iter().for_each(|w| errors.merge(&Errors::of(w, source.mean)));
        if errors.share_below(params.error) >= 1.0 - SHARE {
            break;
        }
    }
    Ok(())
}

impl Work {
    /// The mesh with its values.
    fn mesh(&self) -> LitMesh {
        let lit = |(piece, of): (&fine::Piece, &[u32; 3])| LitTriangle {
            source: piece.source,
            corners: piece.corners,
            values: of.map(|g| self.values[g as usize]),
        };
        LitMesh { triangles: self.fine.pieces.iter().zip(&self.groups.of).map(lit).collect() }
    }
}

/// Area by error, in bins of equal ratio.
struct Errors {
    area: Vec<f64>,
}

/// Bins a factor of e, and the error of the first.
const BINS: f64 = 64.0;
const FIRST: f64 = 1e-5;

impl Default for Errors {
    fn default() -> Self {
        Self { area: vec![0.0; (BINS * (1e3 / FIRST).ln()) as usize] }
    }
}

impl Errors {
    /// The errors of a surface.
    fn of(work: &Work, mean: f32) -> Self {
        let mut errors = Self::default();
        for piece in 0..work.fine.pieces.len() {
            work.each_error(piece, |s, _, difference| {
                let error = relative_error(difference, s.level(mean));
                let bin = errors.bin(error);
                errors.area[bin] += f64::from(s.area);
            });
        }
        errors
    }

    fn bin(&self, error: f64) -> usize {
        ((error.max(FIRST) / FIRST).ln() * BINS).min(self.area.len() as f64 - 1.0) as usize
    }

    fn merge(&mut self, other: &Self) {
        self.area.iter_mut().zip(&other.area).for_each(|(a, b)| *a += b);
    }

    /// The share of the area whose errors are below `error`.
    fn share_below(&self, error: f64) -> f64 {
        let all: f64 = self.area.iter().sum();
        let below: f64 = self.area[..self.bin(error)].iter().sum();
        if all > 0.0 { below / all } else { 1.0 }
    }

    /// The error below which the part `part` of the area lies.
    fn quantile(&self, part: f64) -> f64 {
        let wanted = part * self.area.iter().sum::<f64>();
        let mut below = 0.0;
        let bin = self.area.iter().position(|a| {
            below += a;
            below >= wanted
        });
        bin.map_or(0.0, |bin| FIRST * ((bin as f64 + 1.0) / BINS).exp())
    }
}
