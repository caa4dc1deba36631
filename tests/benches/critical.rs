//! What the critical lines of a real scene cost, and pictures of the receivers that have most, with their light, lines and pieces:
//! `CRITICAL_SCENE=scene.glb CRITICAL_DENSITY=20 cargo bench --ignore-rust-version --bench critical`; with `CRITICAL_BLIND=1` no pictures.

use glam::{DVec3, Vec3};
use lumel::color::luminance;
use lumel::light::Lights;
use lumel::meshing::constrain::{ConstrainParams, constrain};
use lumel::meshing::critical::{CriticalLine, CriticalParams, Order, critical_lines};
use lumel::meshing::fine::{FineMesh, edge};
use lumel::scene::Scene;
use lumel::trace::{Segment, Tracer};
use rayon::prelude::*;

fn main() {
    let Some(path) = std::env::var_os("CRITICAL_SCENE") else {
        return println!("CRITICAL_SCENE names no scene: nothing to draw");
    };
    let density: f64 = std::env::var("CRITICAL_DENSITY").ok().and_then(|d| d.parse().ok()).unwrap_or(20.0);
    let scene = lumel::load::load(path.as_ref()).unwrap().scene;
    let (tracer, lights) = (Tracer::new(&scene), Lights::new(&scene));
    let (start, cpu) = (std::time::Instant::now(), cpu_time::ProcessTime::now());
    let lines = critical_lines(&scene, &tracer, &lights, &CriticalParams::of_density(density));
    let count = |order| lines.iter().filter(|l| l.order == order).count();
    println!(
        "{} triangles: {} jumps, {} bends, {} curves in {:.2?}, {:.2?} of processor time",
        scene.triangle_count(),
        count(Order::Jump),
        count(Order::Bend),
        count(Order::Curve),
        start.elapsed(),
        cpu.elapsed()
    );
    let (start, cpu) = (std::time::Instant::now(), cpu_time::ProcessTime::now());
    let cut = |surface| {
        let mut mesh = FineMesh::new(&scene, surface);
        constrain(&mut mesh, CriticalLine::of_surface(&lines, surface), &ConstrainParams::of_density(density));
        mesh
    };
    let meshes: Vec<FineMesh> = (0..scene.surfaces.len()).map(cut).collect();
    let pieces: usize = meshes.iter().map(|m| m.pieces.len()).sum();
    println!("{pieces} pieces in {:.2?}, {:.2?} of processor time", start.elapsed(), cpu.elapsed());
    if std::env::var_os("CRITICAL_BLIND").is_some() {
        return;
    }
    let mut order: Vec<usize> = (0..meshes.len()).collect();
    order.sort_by_key(|s| std::cmp::Reverse(CriticalLine::of_surface(&lines, *s).len()));
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("critical");
    std::fs::create_dir_all(&folder).unwrap();
    for (k, surface) in order.into_iter().take(4).enumerate() {
        let of_surface = CriticalLine::of_surface(&lines, surface);
        println!("{k}: {} lines on {}", of_surface.len(), scene.surfaces[surface].name);
        let plan = Plan::new(&meshes[surface]);
        plan.light(&scene, &tracer, &lights).lines(of_surface).save(&folder.join(format!("{k}_lines.png")));
        plan.light(&scene, &tracer, &lights).pieces(&meshes[surface]).save(&folder.join(format!("{k}_pieces.png")));
    }
}

/// How a receiver lies on a picture.
pub struct Plan {
    normal: DVec3,
    axes: [DVec3; 2],
    low: [f64; 2],
    height: f64,
    scale: f64,
    size: [usize; 2],
}

pub struct Picture<'a> {
    plan: &'a Plan,
    pixels: Vec<[u8; 3]>,
}

impl Plan {
    pub fn new(mesh: &FineMesh) -> Self {
        let area = |t: &lumel::meshing::fine::Piece| {
            let [a, b, c] = t.points.map(|p| mesh.points[p as usize]);
            (b - a).cross(c - a)
        };
        let largest = mesh.pieces.iter().max_by(|a, b| area(a).length().total_cmp(&area(b).length())).unwrap();
        let normal = area(largest).normalize();
        let x = normal.any_orthonormal_vector();
        let x = if normal.y.abs() > 0.9 { DVec3::X } else { normal.cross(DVec3::Y).try_normalize().unwrap_or(x) };
        let axes = [x, normal.cross(x)];
        let range = |axis: DVec3| {
            let along = mesh.points.iter().map(|p| p.dot(axis));
            along.fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)))
        };
        let (u, v) = (range(axes[0]), range(axes[1]));
        let scale = 1200.0 / (u.1 - u.0).max(v.1 - v.0);
        let size = [(u.1 - u.0) * scale, (v.1 - v.0) * scale].map(|x| x as usize + 1);
        let height = mesh.points[largest.points[0] as usize].dot(normal);
        Self { normal, axes, low: [u.0, v.0], height, scale, size }
    }

    fn at(&self, p: DVec3) -> [f64; 2] {
        [0, 1].map(|k| (p.dot(self.axes[k]) - self.low[k]) * self.scale)
    }

    /// Direct light of polygons and of lights without size, by a few shadow rays.
    pub fn light(&self, scene: &Scene, tracer: &Tracer, lights: &Lights) -> Picture<'_> {
        let shade = |i: usize| {
            let uv = [i % self.size[0], i / self.size[0]].map(|x| (x as f64 + 0.5) / self.scale);
            let p = self.axes[0] * (self.low[0] + uv[0]) + self.axes[1] * (self.low[1] + uv[1]);
            let p = (p + self.normal * (self.height + 1e-4)).as_vec3();
            let n = self.normal.as_vec3();
            let open = |to: Vec3| {
                let mut blocked = [true];
                tracer.occluded(&[Segment { from: p, to: p + (to - p) * 0.999 }], &mut blocked);
                if blocked[0] { 0.0 } else { 1.0 }
            };
            let mut sum = 0.0;
            for polygon in lights.polygons.polygons.iter().take(64) {
                for k in 0..16 {
                    let u = [(k % 4) as f32 * 0.25 + 0.125, (k / 4) as f32 * 0.25 + 0.125];
                    let way = polygon.sample(u) - p;
                    let (d, cos) = (way.length(), way.normalize().dot(n).max(0.0));
                    let cos = cos * polygon.cosine(-way / d);
                    if cos > 0.0 {
                        let power = luminance(polygon.radiance) * polygon.area / 16.0;
                        sum += power * cos / (d * d) * open(p + way);
                    }
                }
            }
            for light in &lights.delta {
                for k in 0..16 {
                    let u = [(k % 4) as f32 * 0.25 + 0.125, (k / 4) as f32 * 0.25 + 0.125];
                    let Some(arrival) = light.arrive(scene, p, u) else { continue };
                    let cos = arrival.towards.dot(n);
                    if cos > 0.0 {
                        let to = p + arrival.towards * arrival.distance.min(1e3);
                        sum += luminance(arrival.illuminance) * cos / 16.0 * open(to);
                    }
                }
            }
            sum
        };
        let values: Vec<f32> = (0..self.size[0] * self.size[1]).into_par_iter().map(shade).collect();
        let mut sorted = values.clone();
        sorted.sort_by(f32::total_cmp);
        let white = sorted[sorted.len() * 98 / 100].max(1e-9);
        let grey = |v: &f32| [(40.0 + 200.0 * (v / white).min(1.0).powf(0.6)) as u8; 3];
        Picture { plan: self, pixels: values.iter().map(grey).collect() }
    }
}

impl Picture<'_> {
    fn line(&mut self, ends: [DVec3; 2], color: [u8; 3]) {
        let [a, b] = ends.map(|p| self.plan.at(p));
        let steps = ((a[0] - b[0]).abs().max((a[1] - b[1]).abs()) * 2.0) as usize + 1;
        for s in 0..=steps {
            let t = s as f64 / steps as f64;
            let [x, y] = [0, 1].map(|k| (a[k] + (b[k] - a[k]) * t) as usize);
            if x < self.plan.size[0] && y < self.plan.size[1] {
                self.pixels[y * self.plan.size[0] + x] = color;
            }
        }
    }

    pub fn lines(mut self, lines: &[CriticalLine]) -> Self {
        for line in lines.iter().rev() {
            let color = match line.order {
                Order::Jump => [255, 40, 40],
                Order::Bend => [40, 90, 255],
                Order::Curve => [40, 200, 80],
            };
            self.line(line.ends, color);
        }
        self
    }

    pub fn pieces(mut self, mesh: &FineMesh) -> Self {
        for piece in &mesh.pieces {
            for k in 0..3 {
                let (a, b) = (piece.points[k], piece.points[(k + 1) % 3]);
                let is_break = mesh.breaks.contains(&edge(a, b));
                let color = if is_break { [255, 40, 40] } else { [200, 150, 40] };
                self.line([a, b].map(|p| mesh.points[p as usize]), color);
            }
        }
        self
    }

    pub fn save(self, path: &std::path::Path) {
        let [w, h] = self.plan.size;
        let bytes = self.pixels.into_flattened();
        image::RgbImage::from_raw(w as u32, h as u32, bytes).unwrap().save(path).unwrap();
    }
}
