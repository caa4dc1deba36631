//! Lights that are no surface, as rays meet them: they shine on what a ray comes from, and block nothing.

use crate::light::Lights;
use crate::light::delta::DeltaLight;
use crate::light::polygon::{Polygon, Source, ball};
use crate::scene::{LightShape, Mesh, Scene, Surface, SurfaceOrigin};
use crate::trace::{Ray, Tracer};
use glam::{Affine3A, Vec3};

/// The polygons, balls and suns among a scene's lights, ready to be met by rays.
pub struct Lamps {
    /// Over the triangles of the polygons' fans.
    tracer: Option<Tracer>,
    /// The polygon of each triangle.
    polygon: Vec<u32>,
    /// Number among [`Lights::delta`], centre and radius [m] of each ball.
    balls: Vec<(usize, Vec3, f32)>,
    /// Number among [`Lights::delta`], direction of the middle, and cosine of the half angle of each sun with a disc.
    suns: Vec<(usize, Vec3, f32)>,
}

/// A lamp that a ray meets.
#[derive(Clone, Copy, Debug)]
pub enum Lamp {
    /// Polygon of the tree, by number.
    Polygon(usize),
    /// A ball, by number among the delta lights.
    Ball(usize),
}

impl Lamps {
    /// Prepares the lamps of `lights`.
    pub fn new(lights: &Lights) -> Self {
        let is_lamp = |p: &Polygon| matches!(p.source, Source::Light { portal: false, .. });
        let lamps = lights.polygons.polygons.iter().enumerate().filter(|(_, p)| is_lamp(p));
        let (mut mesh, mut polygon) = (Mesh::default(), Vec::new());
        for (number, lamp) in lamps {
            let first = mesh.positions.len() as u32;
            mesh.positions.extend(&lamp.corners);
            for k in 1..lamp.corners.len() as u32 - 1 {
                mesh.triangles.push([first, first + k, first + k + 1]);
                polygon.push(number as u32);
            }
        }
        let tracer = (!polygon.is_empty()).then(|| Tracer::new(&scene_of(mesh)));
        let delta = || lights.delta.iter().map(DeltaLight::shape).enumerate();
        let balls = delta().filter_map(|(k, shape)| match shape {
            LightShape::Sphere { world_from_unit, .. } => {
                ball(world_from_unit).map(|(centre, radius)| (k, centre, radius))
            }
            _ => None,
        });
        let suns = delta().filter_map(|(k, shape)| match shape {
            LightShape::Directional { direction, angle, .. } if *angle > 0.0 => {
                Some((k, -*direction, (0.5 * angle.min(std::f32::consts::TAU)).cos()))
            }
            _ => None,
        });
        Self { balls: balls.collect(), suns: suns.collect(), tracer, polygon }
    }

    /// Calls `visit` with each lamp that `ray` meets before `length` [m] on a side that shines, and the distance [m], in no
    /// order.
    pub fn along(&self, ray: &Ray, length: f32, lights: &Lights, mut visit: impl FnMut(Lamp, f32)) {
        if let Some(tracer) = &self.tracer {
            tracer.crossings(ray, |triangle, _| {
                let number = self.polygon[triangle as usize] as usize;
                let polygon = &lights.polygons.polygons[number];
                let t = (polygon.centre - ray.origin).dot(polygon.normal) / ray.direction.dot(polygon.normal);
                if t > 0.0 && t < length && polygon.cosine(-ray.direction) > 0.0 {
                    visit(Lamp::Polygon(number), t);
                }
            });
        }
        for &(number, centre, radius) in &self.balls {
            let way = centre - ray.origin;
            let along = way.dot(ray.direction);
            let height = radius * radius - (way.length_squared() - along * along);
            let t = along - height.max(0.0).sqrt();
            // From inside a ball, which shines outwards, nothing is seen of it.
            if height > 0.0 && t > 0.0 && t < length {
                visit(Lamp::Ball(number), t);
            }
        }
    }

    /// The suns, by number among the delta lights, in whose disc the unit vector `direction` lies.
    pub fn suns(&self, direction: Vec3) -> impl Iterator<Item = usize> {
        self.suns.iter().filter(move |(_, middle, cos)| middle.dot(direction) >= *cos).map(|(number, ..)| *number)
    }
}

/// A scene of one mesh.
fn scene_of(mut mesh: Mesh) -> Scene {
    mesh.triangle_material = vec![0; mesh.triangles.len()];
    let surface = Surface {
        name: "lamps".into(),
        mesh: 0,
        world_from_local: Affine3A::IDENTITY,
        origin: SurfaceOrigin::None,
        role: Default::default(),
    };
    Scene { meshes: vec![mesh], materials: vec![Default::default()], surfaces: vec![surface], ..Scene::default() }
}
