//! What makes a scene look wrong before it is baked: units, albedos and emission that no real scene has.

use crate::color::luminance;
use crate::error::Warnings;
use crate::patch::reflectance::{albedo_at, emission_at};
use crate::scene::Scene;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// A scene whose longest side is outside of this [m] was likely written in other units.
const SIZES: [f32; 2] = [0.005, 5000.0];
/// Whiter than any paint; fresh snow has 0.9.
const WHITE: f32 = 0.9;
/// Share of the scene's area from which on it is said.
const SHARE: f64 = 0.5;
/// Brighter than any lamp that is not looked at through a filter [nit]: a filament has 1e7.
const GLARING: f32 = 1e7;

/// Short lines on what looks wrong in `scene`, with what to do about it. Cost: one look-up a triangle.
pub fn doubts(scene: &Scene) -> Warnings {
    let mut warnings = Warnings::default();
    let parts: Vec<Part> = (0..scene.surfaces.len()).into_par_iter().map(|s| Part::of(scene, s)).collect();
    let mut all = Part::default();
    for (part, surface) in parts.iter().zip(&scene.surfaces) {
        if part.brightest > GLARING {
            let message = "emits more than 1e7 nit, as no lamp does; check its unit, or scale it with [[materials]]";
            warnings.add(format!("{} ({:.1e} nit)", surface.name, part.brightest), message);
        }
        let takes_texels = surface.role.receives && surface.role.lightmapped;
        if takes_texels && part.area > 0.0 && part.clear == part.area {
            let message = "shows nothing and stops no light (opacity 0), but takes texels of the pages; leave it out with \
                           [[objects]] skip = true, or keep it off the pages with lightmapped = false";
            warnings.add(format!("{} ({:.3} m^2)", surface.name, part.area), message);
        }
        all.add(part);
    }
    let size = (all.high - all.low).max_element();
    if all.area > 0.0 && !(SIZES[0]..=SIZES[1]).contains(&size) {
        let message =
            "the scene has an unlikely size; check the units of the export (metersPerUnit in USD, metres in glTF)";
        warnings.add(format!("{size:.3e} m"), message);
    }
    let percent = |area: f64| format!("{:.0} % of the area", 100.0 * area / all.area);
    if all.white > SHARE * all.area {
        let message = "albedos above 0.9 are whiter than paint, and light hardly dies out; check base colours, or give \
                       [[materials]] an albedo-scale";
        warnings.add(percent(all.white), message);
    }
    if all.black > SHARE * all.area {
        let message = "exactly black surfaces reflect nothing; check for textures that are missing, or give [[materials]] an albedo";
        warnings.add(percent(all.black), message);
    }
    warnings
}

/// Of a surface, or of several.
struct Part {
    area: f64,
    white: f64,
    black: f64,
    /// Of opacity 0, whatever its textures say, and without emission.
    clear: f64,
    /// Highest emission [nit].
    brightest: f32,
    low: Vec3,
    high: Vec3,
}

impl Default for Part {
    fn default() -> Self {
        let (low, high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        Self { area: 0.0, white: 0.0, black: 0.0, clear: 0.0, brightest: 0.0, low, high }
    }
}

impl Part {
    fn of(scene: &Scene, surface: usize) -> Self {
        let mesh = &scene.meshes[scene.surfaces[surface].mesh];
        let middle = Vec2::splat(1.0 / 3.0);
        let mut part = Self::default();
        for t in 0..mesh.triangles.len() {
            let [a, b, c] = scene.world_triangle(surface, t);
            let area = 0.5 * (b - a).as_dvec3().cross((c - a).as_dvec3()).length();
            let albedo = albedo_at(scene, mesh, t, middle);
            part.area += area;
            part.white += if luminance(albedo) > WHITE { area } else { 0.0 };
            // What shines need not reflect.
            let is_black = albedo.max_element() == 0.0 && !scene.material(surface, t).is_emissive();
            part.black += if is_black { area } else { 0.0 };
            let material = scene.material(surface, t);
            // Alpha of textures and vertices only takes away.
            let is_clear = material.alpha.share(1.0) == 0.0 && !material.is_emissive();
            part.clear += if is_clear { area } else { 0.0 };
            part.brightest = part.brightest.max(emission_at(scene, mesh, t, middle).max_element());
            part.low = part.low.min(a).min(b).min(c);
            part.high = part.high.max(a).max(b).max(c);
        }
        part
    }

    fn add(&mut self, other: &Self) {
        self.area += other.area;
        self.white += other.white;
        self.black += other.black;
        self.low = self.low.min(other.low);
        self.high = self.high.max(other.high);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Alpha, Material, Mesh, Surface, SurfaceOrigin, TriangleOrigin};
    use glam::Affine3A;

    /// Two triangles of equal area, `size` [m] long, in the materials given.
    fn messages(size: f32, materials: [Material; 2]) -> String {
        let mesh = Mesh {
            positions: [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE].map(|p| p * size).to_vec(),
            triangles: vec![[0, 1, 2], [0, 2, 1]],
            triangle_material: vec![0, 1],
            origin: vec![TriangleOrigin::default(); 2],
            ..Mesh::default()
        };
        let surface = Surface {
            name: "a".into(),
            mesh: 0,
            world_from_local: Affine3A::IDENTITY,
            origin: SurfaceOrigin::None,
            role: Default::default(),
        };
        let scene =
            Scene { meshes: vec![mesh], materials: materials.to_vec(), surfaces: vec![surface], ..Scene::default() };
        doubts(&scene).iter().map(|w| format!("{}: {}\n", w.places[0], w.message)).collect()
    }

    #[test]
    fn each_doubt_has_its_line_and_a_sound_scene_none() {
        let of = |albedo: f32| Material { albedo: Vec3::splat(albedo), ..Material::default() };
        assert_eq!(messages(2.0, [of(0.5), of(0.95)]), "");
        assert!(messages(2.0, [of(0.95), of(0.95)]).starts_with("100 % of the area: albedos above 0.9"));
        assert!(messages(2.0, [of(0.0), of(0.0)]).contains("exactly black"));
        assert!(messages(0.001, [of(0.5), of(0.5)]).contains("unlikely size"));
        assert!(messages(9000.0, [of(0.5), of(0.5)]).contains("unlikely size"));
        let clear = Material { alpha: Alpha::Mask { cutoff: 0.5, opacity: 0.0 }, ..of(0.5) };
        assert!(
            messages(2.0, [clear.clone(), clear.clone()]).contains("(4.000 m^2): shows nothing and stops no light")
        );
        assert_eq!(messages(2.0, [of(0.5), clear]), "");
        let bright = Material { emission: Vec3::splat(1e9), ..of(0.0) };
        assert!(messages(2.0, [of(0.5), bright]).starts_with("a (1.0e9 nit): emits"));
    }
}
