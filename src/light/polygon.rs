//! Everything that shines over an area, as polygons of one radiance each.
//!
//! Disks are 32-gons, ellipsoids geodesic and cylinders prismatic, each scaled so that its area, and with it its power, is exact.

use super::Shining;
use super::picture_cells::cells;
use crate::color::Rgb;
use crate::contour::above_horizon;
use crate::patch::reflectance::emission_at;
use crate::sample::warp::triangle;
use crate::scene::{Alpha, Light, LightShape, Linked, Picture, Scene};
use glam::{Affine3A, Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// A planar polygon that shines.
#[derive(Clone, Debug)]
pub struct Polygon {
    /// Corners [m]: 3 or 4, or 32 for a disk.
    pub corners: Vec<Vec3>,
    pub centre: Vec3,
    /// The side it shines to, unit.
    pub normal: Vec3,
    /// Largest distance of a corner from the centre [m].
    pub radius: f32,
    /// Area [m^2].
    pub area: f32,
    /// Mean radiance [nit].
    pub radiance: Rgb,
    pub two_sided: bool,
    pub source: Source,
    /// The surfaces that it shines on.
    pub lit: Linked,
    /// Its number among [`super::Lights::shades`]; none where every surface blocks it.
    pub shade: Option<u16>,
}

/// What the polygon belongs to.
#[derive(Clone, Debug)]
pub enum Source {
    /// An emissive triangle; `textured` where its radiance varies over it.
    Surface { surface: usize, triangle: usize, textured: bool },
    /// A light that is no surface, by its number; `varied` where its radiance differs over it or by direction, `portal` where it
    /// is a portal to the sky.
    Light { light: usize, varied: bool, portal: bool },
}

/// Corners of a disk light's polygon.
const DISK_CORNERS: usize = 32;
/// Sides of a cylinder light.
const CYLINDER_SIDES: usize = 24;
/// Subdivisions of a sphere light's octahedron: 512 triangles.
const SPHERE_LEVELS: u32 = 3;

/// All polygons of `scene` that shine, of what `holds` is true of. `shade` tells a light's number among those that only some surfaces block.
pub fn polygons(scene: &Scene, holds: impl Fn(Shining) -> bool, shade: impl Fn(&Light) -> Option<u16>) -> Vec<Polygon> {
    let mut all = Vec::new();
    for (s, placed) in scene.surfaces.iter().enumerate().filter(|(_, placed)| placed.role.casts) {
        let mesh = &scene.meshes[placed.mesh];
        for t in 0..mesh.triangles.len() {
            let material = scene.material(s, t);
            if !material.is_emissive() || !holds(Shining::Material(mesh.triangle_material[t] as usize)) {
                continue;
            }
            let textured = material.emission_texture.is_some() || material.alpha != Alpha::Opaque;
            let radiance = if textured { mean_emission(scene, s, t) } else { material.emission };
            let source = Source::Surface { surface: s, triangle: t, textured };
            all.extend(Polygon::new(scene.world_triangle(s, t).to_vec(), radiance, material.double_sided, source));
        }
    }
    for (l, light) in scene.lights.iter().enumerate().filter(|(l, _)| holds(Shining::Light(*l))) {
        let shade = shade(light);
        let portal = matches!(light.shape, LightShape::Portal { .. });
        let mut push = |corners: Vec<Vec3>, radiance: Rgb| {
            let source = Source::Light { light: l, varied: !light.is_plain(), portal };
            let polygon = Polygon::new(corners, radiance, false, source);
            all.extend(polygon.map(|polygon| Polygon { lit: light.links.lit.clone(), shade, ..polygon }));
        };
        match &light.shape {
            LightShape::Rect { center, u, v, radiance } => match light.picture {
                Some(Picture::OnLight(texture)) => {
                    for cell in cells(&scene.textures[texture]) {
                        let mean = *radiance * cell.mean;
                        push(cell.corners(light, *center, *u, *v), mean);
                    }
                }
                _ => push(parallelogram(*center, *u, *v), *radiance),
            },
            LightShape::Portal { center, u, v, sky } if sky.is_constant() => {
                push(parallelogram(*center, *u, *v), sky.radiance_from(scene, Vec3::Y));
            }
            LightShape::Disk { center, u, v, radiance } => {
                // Area of the n-gon inside the unit circle against the circle's.
                let n = DISK_CORNERS as f32;
                let grow = (PI / (0.5 * n * (TAU / n).sin())).sqrt();
                let corner = |k: usize| {
                    let a = TAU * k as f32 / n;
                    *center + (*u * a.cos() - *v * a.sin()) * grow
                };
                push((0..DISK_CORNERS).map(corner).collect(), *radiance);
            }
            // A round one is a light of its own, see `super::delta`.
            LightShape::Sphere { world_from_unit, radiance } if ball(world_from_unit).is_none() => {
                for t in sphere(*world_from_unit) {
                    push(t.to_vec(), *radiance);
                }
            }
            LightShape::Cylinder { world_from_unit, radiance } => {
                for q in cylinder(*world_from_unit) {
                    push(q.to_vec(), *radiance);
                }
            }
            LightShape::Sphere { .. }
            | LightShape::Portal { .. }
            | LightShape::Point { .. }
            | LightShape::Spot { .. }
            | LightShape::Directional { .. } => {}
        }
    }
    all
}

/// The corners of a rect light or portal: it shines along -(u x v).
fn parallelogram(center: Vec3, u: Vec3, v: Vec3) -> Vec<Vec3> {
    vec![center - u - v, center - u + v, center + u + v, center + u - v]
}

impl Polygon {
    /// `None` where it has no area or no light. It shines to the side from which the corners turn counter-clockwise.
    fn new(corners: Vec<Vec3>, radiance: Rgb, two_sided: bool, source: Source) -> Option<Self> {
        let o = corners[0];
        let twice = corners[1..].windows(2).map(|w| (w[0] - o).cross(w[1] - o)).sum::<Vec3>();
        let area = 0.5 * twice.length();
        let centre = corners.iter().sum::<Vec3>() / corners.len() as f32;
        let shines = area > 0.0 && area.is_finite() && radiance.max_element() > 0.0;
        let radius = corners.iter().map(|c| c.distance(centre)).fold(0.0, f32::max);
        shines.then(|| Self {
            corners,
            centre,
            normal: twice.normalize(),
            radius,
            area,
            radiance,
            two_sided,
            source,
            lit: Linked::All,
            shade: None,
        })
    }

    /// A point uniform over the area.
    pub fn sample(&self, u: [f32; 2]) -> Vec3 {
        sample_fan(&self.corners, self.area, u)
    }

    /// A point uniform over the part above the horizon of a receiver, and that part's area [m^2]; `None` where nothing is.
    pub fn sample_above(&self, position: Vec3, normal: Vec3, u: [f32; 2]) -> Option<(Vec3, f32)> {
        if self.corners.iter().all(|c| (*c - position).dot(normal) >= 0.0) {
            return Some((self.sample(u), self.area));
        }
        let clipped = above_horizon(position, normal, &self.corners);
        let (o, rest) = clipped.corners().split_first()?;
        let area = 0.5 * rest.windows(2).map(|w| (w[0] - *o).cross(w[1] - *o)).sum::<Vec3>().length();
        (area > 0.0).then(|| (position + sample_fan(clipped.corners(), area, u), area))
    }

    /// True where the polygon shines to the side on which `position` lies, more than `tolerance` [m] from its plane: a point in
    /// the plane sees nothing of it, whatever side rounding puts it on.
    pub fn faces(&self, position: Vec3, tolerance: f32) -> bool {
        let height = (position - self.centre).dot(self.normal);
        height > tolerance || (self.two_sided && height < -tolerance)
    }

    /// The cosine at which light leaves along the unit vector `direction`; 0 on the dark side.
    pub fn cosine(&self, direction: Vec3) -> f32 {
        let cos = self.normal.dot(direction);
        if self.two_sided { cos.abs() } else { cos.max(0.0) }
    }

    /// Radiance from the point `at` on the polygon along the unit vector `direction` [nit].
    pub fn radiance_towards(&self, scene: &Scene, at: Vec3, direction: Vec3) -> Rgb {
        match &self.source {
            Source::Surface { surface, triangle, textured: true } => {
                let mesh = &scene.meshes[scene.surfaces[*surface].mesh];
                emission_at(scene, mesh, *triangle, self.weights(scene, *surface, at))
            }
            Source::Light { light, varied: true, .. } => {
                let light = &scene.lights[*light];
                let radiance = match &light.shape {
                    LightShape::Rect { radiance, .. } => *radiance,
                    _ => self.radiance,
                };
                radiance * light.factor(scene, at, direction)
            }
            _ => self.radiance,
        }
    }

    /// True where its light comes from beyond it, from the sky.
    pub fn is_portal(&self) -> bool {
        matches!(self.source, Source::Light { portal: true, .. })
    }

    /// Weights of corners 1 and 2 (mesh order) of a triangle's point.
    fn weights(&self, scene: &Scene, surface: usize, at: Vec3) -> Vec2 {
        let (a, b, c) = (self.corners[0], self.corners[1], self.corners[2]);
        let n = (b - a).cross(c - a);
        let square = n.length_squared();
        let v = (at - a).cross(c - a).dot(n) / square;
        let w = (b - a).cross(at - a).dot(n) / square;
        if scene.surfaces[surface].is_mirrored() { Vec2::new(w, v) } else { Vec2::new(v, w) }
    }
}

/// A point uniform over the convex polygon `corners` of `area`.
fn sample_fan(corners: &[Vec3], area: f32, u: [f32; 2]) -> Vec3 {
    let o = corners[0];
    let fan_area = |k: usize| 0.5 * (corners[k] - o).cross(corners[k + 1] - o).length();
    let mut at = u[0] * area;
    let mut k = 1;
    while k < corners.len() - 2 && at >= fan_area(k) {
        at -= fan_area(k);
        k += 1;
    }
    let u0 = (at / fan_area(k).max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
    let w = triangle([u0, u[1]]);
    o + (corners[k] - o) * w.x + (corners[k + 1] - o) * w.y
}

/// Mean of the textured emission of a triangle, by a grid of 16 x 16 points.
fn mean_emission(scene: &Scene, surface: usize, t: usize) -> Rgb {
    const SIDE: usize = 16;
    let mesh = &scene.meshes[scene.surfaces[surface].mesh];
    let mut sum = Rgb::ZERO;
    for y in 0..SIDE {
        for x in 0..SIDE {
            let u = [(x as f32 + 0.5) / SIDE as f32, (y as f32 + 0.5) / SIDE as f32];
            sum += emission_at(scene, mesh, t, triangle(u));
        }
    }
    sum / (SIDE * SIDE) as f32
}

/// Centre and radius [m] of the unit sphere under a transform that keeps it round, to 0.1 %.
pub fn ball(world_from_unit: &Affine3A) -> Option<(Vec3, f32)> {
    let axes = [world_from_unit.matrix3.x_axis, world_from_unit.matrix3.y_axis, world_from_unit.matrix3.z_axis];
    let radius = axes[0].length();
    let alike = axes.iter().all(|a| (a.length() - radius).abs() <= 1e-3 * radius);
    let square = [(0, 1), (1, 2), (2, 0)].iter().all(|&(i, j)| axes[i].dot(axes[j]).abs() <= 1e-3 * radius * radius);
    (alike && square && radius > 0.0).then(|| (world_from_unit.translation.into(), radius))
}

/// The triangles of an ellipsoid, outward.
fn sphere(world_from_unit: Affine3A) -> Vec<[Vec3; 3]> {
    // An octahedron's faces, subdivided; each level quarters them.
    let mut faces: Vec<[Vec3; 3]> = Vec::new();
    for x in [Vec3::X, Vec3::NEG_X] {
        for y in [Vec3::Y, Vec3::NEG_Y] {
            for z in [Vec3::Z, Vec3::NEG_Z] {
                let outward = x.cross(y).dot(z) > 0.0;
                faces.push(if outward { [x, y, z] } else { [x, z, y] });
            }
        }
    }
    for _ in 0..SPHERE_LEVELS {
        faces = faces
            .iter()
            .flat_map(|&[a, b, c]| {
                let [ab, bc, ca] = [(a + b).normalize(), (b + c).normalize(), (c + a).normalize()];
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    let area: f32 = faces.iter().map(|[a, b, c]| 0.5 * (*b - *a).cross(*c - *a).length()).sum();
    let grow = (4.0 * PI / area).sqrt();
    let mirrored = world_from_unit.matrix3.determinant() < 0.0;
    faces
        .into_iter()
        .map(|f| {
            let [a, b, c] = f.map(|p| world_from_unit.transform_point3(p * grow));
            if mirrored { [a, c, b] } else { [a, b, c] }
        })
        .collect()
}

/// The sides of a cylinder around X, outward.
fn cylinder(world_from_unit: Affine3A) -> Vec<[Vec3; 4]> {
    let n = CYLINDER_SIDES as f32;
    // Circumference of the n-gon inside the unit circle against the circle's.
    let grow = TAU / (2.0 * n * (PI / n).sin());
    let mirrored = world_from_unit.matrix3.determinant() < 0.0;
    (0..CYLINDER_SIDES)
        .map(|k| {
            let rim = |k: usize, x: f32| {
                let a = TAU * k as f32 / n;
                world_from_unit.transform_point3(Vec3::new(x, a.cos() * grow, a.sin() * grow))
            };
            let quad = [rim(k, -1.0), rim(k + 1, -1.0), rim(k + 1, 1.0), rim(k, 1.0)];
            if mirrored { [quad[0], quad[3], quad[2], quad[1]] } else { quad }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_lights_keep_their_area_and_face_outwards() {
        let place = Affine3A::from_translation(Vec3::new(1.0, 2.0, 3.0)) * Affine3A::from_scale(Vec3::splat(0.5));
        let mut area = 0.0;
        for t in sphere(place) {
            let p = Polygon::new(t.to_vec(), Rgb::ONE, false, Source::Light { light: 0, varied: false, portal: false })
                .unwrap();
            assert!(p.normal.dot(p.centre - Vec3::new(1.0, 2.0, 3.0)) > 0.0);
            area += p.area;
        }
        assert!((area - 4.0 * PI * 0.25).abs() < 1e-3, "{area}");
        let mut area = 0.0;
        for q in cylinder(place) {
            let p = Polygon::new(q.to_vec(), Rgb::ONE, false, Source::Light { light: 0, varied: false, portal: false })
                .unwrap();
            let out = p.centre - Vec3::new(1.0, 2.0, 3.0);
            assert!(p.normal.dot(Vec3::new(0.0, out.y, out.z)) > 0.0);
            area += p.area;
        }
        assert!((area - TAU * 0.5 * 1.0).abs() < 1e-3, "{area}");
    }
}
