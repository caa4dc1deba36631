//! Small scenes for methods that follow rays, and z-tests of one against another over independent runs.
#![allow(dead_code)]

use crate::support::{Quad, room, scene, triangles};
use glam::{Affine3A, Vec3};
use lumel::color::{Rgb, luminance};
use lumel::integrate::bidirectional::Bidirectional;
use lumel::integrate::metropolis::Metropolis;
use lumel::integrate::{Integrator, Pixelwise, Walk, World};
use lumel::light::Lights;
use lumel::medium::Media;
use lumel::progress::Silent;
use lumel::scatter::{Scattering, Surfaces, adapt};
use lumel::scene::{Appearance, Camera, Material, Mesh, Scene, Surface, SurfaceOrigin, TriangleOrigin, Walls};
use lumel::sensor::{Film, Sensor, View};
use lumel::trace::Tracer;

/// A scene with all that rays need.
pub struct Prepared {
    pub scene: Scene,
    pub tracer: Tracer,
    pub lights: Lights,
    pub scattering: Scattering,
    pub media: Media,
}

impl Prepared {
    pub fn new(mut scene: Scene) -> Self {
        adapt(&mut scene, Surfaces::Full);
        let (tracer, lights) = (Tracer::new(&scene), Lights::new(&scene));
        let (scattering, media) = (Scattering::new(&scene, Surfaces::Full), Media::new(&scene));
        Self { tracer, lights, scattering, media, scene }
    }

    pub fn world(&self) -> World<'_> {
        World::new(&self.scene, &self.tracer, &self.lights, &self.scattering, &self.media)
    }
}

/// A method under test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    Path,
    Bidirectional,
    Metropolis,
}

/// What `way` makes of what `sensor` measures in `passes`.
pub fn film(way: Way, world: &World, sensor: &dyn Sensor, passes: u32, max_bounces: Option<u32>, seed: u32) -> Film {
    let both = || Bidirectional::new(world, sensor, max_bounces, seed, "under test").unwrap();
    let mut method: Box<dyn Integrator> = match way {
        Way::Path => Box::new(Pixelwise { world, sensor, method: Walk::Path, max_bounces, seed }),
        Way::Bidirectional => Box::new(both()),
        Way::Metropolis => Box::new(Metropolis::new(both())),
    };
    passes_of(&mut *method, sensor, passes)
}

pub fn passes_of(method: &mut dyn Integrator, sensor: &dyn Sensor, passes: u32) -> Film {
    let mut film = Film::new(sensor.len());
    (0..passes).for_each(|_| method.pass(&mut film, &Silent).unwrap());
    film
}

/// Means over square blocks of a picture, or runs of texels.
pub fn blocks(values: &[Rgb], width: usize, block: usize) -> Vec<f64> {
    let columns = width / block;
    let mut sums = vec![(0.0, 0.0); columns * (values.len() / width).div_ceil(block)];
    for (i, value) in values.iter().enumerate() {
        let (x, y) = (i % width / block, i / width / block);
        let sum = &mut sums[y * columns + x.min(columns - 1)];
        *sum = (sum.0 + f64::from(luminance(*value)), sum.1 + 1.0);
    }
    sums.iter().map(|(sum, n)| sum / n).collect()
}

/// Mean and standard error over independent runs, each a list of numbers.
pub struct Runs {
    pub mean: Vec<f64>,
    pub error: Vec<f64>,
}

impl Runs {
    pub fn of(count: u32, run: impl Fn(u32) -> Vec<f64>) -> Self {
        let all: Vec<Vec<f64>> = (0..count).map(run).collect();
        let n = f64::from(count);
        let mean: Vec<f64> = (0..all[0].len()).map(|k| all.iter().map(|run| run[k]).sum::<f64>() / n).collect();
        let error = |(k, mean): (usize, &f64)| {
            (all.iter().map(|run| (run[k] - mean).powi(2)).sum::<f64>() / (n * (n - 1.0))).sqrt()
        };
        Self { error: mean.iter().enumerate().map(error).collect(), mean }
    }

    /// The whole, and its standard error.
    pub fn whole(&self) -> f64 {
        self.mean.iter().sum::<f64>() / self.mean.len() as f64
    }

    /// Root mean square and mean of the differences over their standard errors, and the relative difference of the whole.
    pub fn against(&self, other: &Self) -> [f64; 3] {
        let z = (0..self.mean.len()).filter_map(|k| {
            let error = self.error[k].hypot(other.error[k]);
            (error > 0.0).then(|| (self.mean[k] - other.mean[k]) / error)
        });
        let z: Vec<f64> = z.collect();
        let n = z.len() as f64;
        let spread = (z.iter().map(|z| z * z).sum::<f64>() / n).sqrt();
        [spread, z.iter().sum::<f64>() / n, self.whole() / other.whole() - 1.0]
    }
}

/// What stands in the box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    Diffuse,
    Mirror,
    Glass,
    Glossy,
    Coated,
}

/// A closed box of 2 m with a coloured wall on either side, a lamp below the ceiling, and a block on the floor.
pub fn cornell(standing: Standing) -> Scene {
    let mut quads: Vec<Quad> = room([2.0; 3]).into_iter().map(|q| q.albedo(0.6)).collect();
    quads.push(Quad::new([0.6, 1.95, 0.6], [0.8, 0., 0.], [0., 0., 0.8]).albedo(0.0).emission(10.0));
    let mut scene = scene(&quads);
    scene.materials[2].albedo = Rgb::new(0.6, 0.1, 0.1);
    scene.materials[3].albedo = Rgb::new(0.1, 0.6, 0.1);
    let look = match standing {
        Standing::Diffuse => None,
        Standing::Mirror => Some(Appearance { base_color: Rgb::splat(0.9), metallic: 1.0, ..Default::default() }),
        Standing::Glossy => {
            Some(Appearance { base_color: Rgb::splat(0.8), metallic: 1.0, roughness: 0.4, ..Default::default() })
        }
        Standing::Coated => Some(Appearance {
            base_color: Rgb::new(0.7, 0.5, 0.2),
            roughness: 0.6,
            clearcoat: 1.0,
            clearcoat_roughness: 0.0,
            ..Default::default()
        }),
        Standing::Glass => Some(Appearance {
            transmission: 1.0,
            walls: Walls::Solid { absorption: Rgb::new(0.1, 0.5, 0.9) },
            ..Default::default()
        }),
    };
    let material = Material { albedo: Rgb::splat(0.5), appearance: look, ..Material::default() };
    add(&mut scene, &block(Vec3::new(0.7, 0.3, 0.6), Vec3::new(0.6, 0.8, 0.6)), material);
    scene
}

/// A view into the box.
pub fn view(width: u32, height: u32) -> View {
    let camera = Camera::look_at(Vec3::new(1.0, 1.1, 1.95), Vec3::new(1.0, 0.9, 0.0), 1.2).unwrap();
    View::new(camera, width, height)
}

/// The outer faces of a box.
pub fn block(corner: Vec3, size: Vec3) -> Vec<[Vec3; 3]> {
    let faces = room(size.to_array()).into_iter().flat_map(|q| triangles(&q));
    faces.map(|[a, b, c]| [a + corner, c + corner, b + corner]).collect()
}

/// Adds a surface of its own material.
pub fn add(scene: &mut Scene, triangles: &[[Vec3; 3]], material: Material) {
    let index = scene.materials.len() as u32;
    scene.materials.push(material);
    let name = format!("added {index}");
    let count = triangles.len();
    scene.surfaces.push(Surface {
        name: name.clone(),
        mesh: scene.meshes.len(),
        world_from_local: Affine3A::IDENTITY,
        origin: SurfaceOrigin::None,
        role: Default::default(),
    });
    scene.meshes.push(Mesh {
        name,
        positions: triangles.iter().flatten().copied().collect(),
        triangles: (0..count as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect(),
        triangle_material: vec![index; count],
        origin: vec![TriangleOrigin::default(); count],
        ..Mesh::default()
    });
}

/// A room in which everything emits 1 nit and reflects half, so that all of it shines with 2 nit; and a view of it.
pub fn furnace() -> (Prepared, View) {
    let quads: Vec<Quad> = room([2., 1., 3.]).into_iter().map(|q| q.albedo(0.5).emission(1.0)).collect();
    let camera = Camera::look_at(Vec3::new(1.0, 0.5, 2.5), Vec3::new(1.0, 0.4, 0.0), 1.0).unwrap();
    (Prepared::new(scene(&quads)), View::new(camera, 16, 16))
}
