//! What a bake would see: surfaces with their areas, lights with their units, texels at the density asked for.
//!
//! Areas are sums over world-space triangles in f64. Power is `pi L A` of Lambertian emitters and the integral of the
//! intensity of point lights; it is what leaves the light, before anything blocks it. Cost: one pass over the triangles and
//! over the texels of the textures in use.

mod light;

use crate::color::{Rgb, luminance};
use crate::error::Warnings;
use crate::load::Loaded;
use crate::scene::{Environment, Material, Mesh, Scene, TextureSlot};
use crate::settings::Settings;
use crate::unwrap::Density;
use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;
use serde::Serialize;
use std::f64::consts::PI;

/// The share of a page that charts fill, for the estimate of pages; what xatlas reaches on rooms and furniture.
const PACKING: f64 = 0.7;
/// Points along each edge of an emissive triangle at which its emission texture is read.
const EMISSION_STEPS: usize = 8;

/// A scene as a bake sees it.
#[derive(Clone, Debug, Serialize)]
pub struct Inspection {
    pub surfaces: Vec<SurfaceInfo>,
    /// Meshes that more than one surface uses.
    pub shared_meshes: Vec<SharedMesh>,
    pub lights: Vec<LightInfo>,
    /// The skies, whose light adds up.
    pub environment: Vec<EnvironmentInfo>,
    /// False where nothing shines: a bake then needs a sky or an environment.
    pub has_light: bool,
    /// Corners of the box around all surfaces [m].
    pub bounds: [[f32; 3]; 2],
    /// Triangles, instances counted each.
    pub triangles: usize,
    /// Sum of the surfaces' areas [m^2].
    pub area: f64,
    /// Area that emits, each side of a double-sided one counted [m^2].
    pub emissive_area: f64,
    /// Luminous power of all emissive surfaces [lm].
    pub emissive_power: f64,
    pub estimate: Estimate,
    pub warnings: Warnings,
}

/// A surface.
#[derive(Clone, Debug, Serialize)]
pub struct SurfaceInfo {
    pub name: String,
    pub mesh: String,
    pub triangles: usize,
    /// World-space area [m^2].
    pub area: f64,
    /// Names of its materials, in the order of their first triangle.
    pub materials: Vec<String>,
    /// Lowest and highest albedo by channel, over its materials, their textures and the vertex colours.
    pub albedo: [[f32; 3]; 2],
    /// Area that emits, each side counted [m^2].
    pub emissive_area: f64,
    /// Luminous power [lm].
    pub emissive_power: f64,
}

/// A mesh with the number of surfaces that use it.
#[derive(Clone, Debug, Serialize)]
pub struct SharedMesh {
    pub name: String,
    pub surfaces: usize,
}

/// A light that is no surface.
#[derive(Clone, Debug, Serialize)]
pub struct LightInfo {
    pub name: String,
    /// `point`, `spot`, `directional`, `rect`, `disk`, `sphere`, `cylinder` or `portal`.
    pub kind: &'static str,
    /// Its intensity, illuminance or radiance, by `unit`.
    pub value: [f32; 3],
    /// `cd`, `lx` or `nit`.
    pub unit: &'static str,
    /// Emitting area [m^2]; none for those that have none.
    pub area: Option<f64>,
    /// Luminous power [lm]; none for directional lights and portals, which have no bound.
    pub power: Option<f64>,
    /// Restricted by a cone or focus.
    pub shaped: bool,
    pub profile: Option<ProfileInfo>,
    pub picture: Option<PictureInfo>,
    /// How many surfaces it lights, and how many block it; none: all.
    pub lights_surfaces: Option<usize>,
    pub blocking_surfaces: Option<usize>,
}

/// A measured distribution.
#[derive(Clone, Debug, Serialize)]
pub struct ProfileInfo {
    pub name: String,
    /// Luminous power of the profile itself [lm], and what its file states of its lamps.
    pub power: f64,
    pub rated_lumens: Option<f64>,
}

/// A picture on a light, or thrown by it.
#[derive(Clone, Debug, Serialize)]
pub struct PictureInfo {
    pub name: String,
    /// Width and height [texels].
    pub size: [u32; 2],
    pub thrown: bool,
    /// Distorted so that it lands square on a target.
    pub keystone: bool,
}

/// The sky.
#[derive(Clone, Debug, Serialize)]
pub struct EnvironmentInfo {
    pub name: String,
    /// Radiance, or the factor on the texture [nit].
    pub radiance: [f32; 3],
    /// Its picture and size [texels].
    pub texture: Option<(String, [u32; 2])>,
}

/// How many texels a bake would have, about: packing is not tried.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Estimate {
    /// Texels per metre.
    pub density: f64,
    /// Texels that surfaces cover.
    pub texels: u64,
    pub pages: u64,
    /// Largest page [texels], square.
    pub page_size: u32,
}

/// Looks at a loaded scene.
pub fn inspect(loaded: &Loaded, settings: &Settings) -> Inspection {
    let scene = &loaded.scene;
    let ranges = texture_ranges(scene);
    let surfaces: Vec<SurfaceInfo> =
        (0..scene.surfaces.len()).into_par_iter().map(|i| surface_info(scene, i, &ranges)).collect();
    let area = surfaces.iter().map(|s| s.area).sum();
    let mut uses = vec![0; scene.meshes.len()];
    scene.surfaces.iter().for_each(|s| uses[s.mesh] += 1);
    let shared = scene.meshes.iter().zip(uses).filter(|(_, n)| *n > 1);
    Inspection {
        shared_meshes: shared.map(|(m, surfaces)| SharedMesh { name: m.name.clone(), surfaces }).collect(),
        lights: scene.lights.iter().map(|light| light::light_info(scene, light)).collect(),
        environment: scene.environment.iter().flat_map(Environment::each).map(|e| environment_info(scene, e)).collect(),
        has_light: scene.has_light(),
        bounds: bounds(scene).map(|p| p.to_array()),
        triangles: scene.triangle_count(),
        area,
        emissive_area: surfaces.iter().map(|s| s.emissive_area).sum(),
        emissive_power: surfaces.iter().map(|s| s.emissive_power).sum(),
        estimate: estimate(area, settings),
        surfaces,
        warnings: loaded.warnings.clone(),
    }
}

/// Texels and pages of `scene`, about.
pub fn estimate_of(scene: &Scene, settings: &Settings) -> Estimate {
    let area = |surface: usize| -> f64 {
        let count = scene.meshes[scene.surfaces[surface].mesh].triangles.len();
        let twice = |t: usize| {
            let [a, b, c] = scene.world_triangle(surface, t).map(|p| p.as_dvec3());
            (b - a).cross(c - a).length()
        };
        0.5 * (0..count).map(twice).sum::<f64>()
    };
    let areas: Vec<f64> = (0..scene.surfaces.len()).into_par_iter().map(area).collect();
    estimate(areas.iter().sum(), settings)
}

/// Texels and pages for `area` [m^2] of surface.
fn estimate(area: f64, settings: &Settings) -> Estimate {
    let params = settings.unwrap_params();
    // A scene without area has no density; 1 keeps the numbers finite.
    let area = if area > 0.0 { area } else { 1.0 };
    let (density, page_size) = match params.density {
        Density::TexelsPerMetre(d) => (f64::from(d), params.page_size),
        Density::TexelCount(n) => ((n as f64 / area).sqrt(), params.page_size),
        Density::FillPage(n) => ((PACKING * f64::from(n).powi(2) / area).sqrt(), n),
    };
    let per_page = PACKING * f64::from(page_size).powi(2);
    let most = match params.density {
        Density::FillPage(_) => 1,
        _ => u64::from(params.max_pages.max(1)),
    };
    let texels = area * density * density;
    let pages = ((texels / per_page).ceil() as u64).clamp(1, most);
    // More than fit on the pages: the density falls until they do.
    let fitting = (pages as f64 * per_page).min(texels);
    Estimate { density: density * (fitting / texels).sqrt(), texels: fitting.round() as u64, pages, page_size }
}

fn surface_info(scene: &Scene, index: usize, ranges: &[Option<[Vec4; 2]>]) -> SurfaceInfo {
    let surface = &scene.surfaces[index];
    let mesh = &scene.meshes[surface.mesh];
    let (mut area, mut emissive_area, mut emissive_power) = (0.0, 0.0, 0.0);
    let mut materials: Vec<u32> = Vec::new();
    for t in 0..mesh.triangles.len() {
        let [a, b, c] = scene.world_triangle(index, t).map(|p| p.as_dvec3());
        let triangle_area = 0.5 * (b - a).cross(c - a).length();
        area += triangle_area;
        let id = mesh.triangle_material[t];
        if !materials.contains(&id) {
            materials.push(id);
        }
        let material = &scene.materials[id as usize];
        if material.is_emissive() {
            let sides = if material.double_sided { 2.0 } else { 1.0 };
            emissive_area += sides * triangle_area;
            emissive_power +=
                sides * triangle_area * PI * f64::from(luminance(mean_emission(scene, mesh, t, material)));
        }
    }
    let mut albedo = [Rgb::INFINITY, Rgb::NEG_INFINITY];
    for &m in &materials {
        let [low, high] = albedo_range(&scene.materials[m as usize], mesh, ranges);
        albedo = [albedo[0].min(low), albedo[1].max(high)];
    }
    let materials = materials.iter().map(|&m| scene.materials[m as usize].name.clone()).collect();
    SurfaceInfo {
        name: surface.name.clone(),
        mesh: mesh.name.clone(),
        triangles: mesh.triangles.len(),
        area,
        materials,
        albedo: albedo.map(|c| c.to_array()),
        emissive_area,
        emissive_power,
    }
}

/// Lowest and highest albedo that a material can have on a mesh, by channel.
fn albedo_range(material: &Material, mesh: &Mesh, ranges: &[Option<[Vec4; 2]>]) -> [Rgb; 2] {
    let texture = material.albedo_texture.as_ref().and_then(|slot| {
        let [low, high] = ranges.get(slot.texture).copied().flatten()?;
        let (a, b) = (low * slot.scale + slot.bias, high * slot.scale + slot.bias);
        Some([a.min(b).truncate(), a.max(b).truncate()])
    });
    let texture = texture.unwrap_or([Rgb::ONE; 2]);
    let colors = mesh.colors.iter().map(|c| c.truncate()).fold(None, |range: Option<[Rgb; 2]>, c| match range {
        None => Some([c, c]),
        Some([low, high]) => Some([c.min(low), c.max(high)]),
    });
    let colors = colors.unwrap_or([Rgb::ONE; 2]);
    [0, 1].map(|k| (material.albedo * texture[k] * colors[k]).clamp(Rgb::ZERO, Rgb::ONE))
}

/// Lowest and highest value by channel of each texture that an albedo uses; none for the others.
fn texture_ranges(scene: &Scene) -> Vec<Option<[Vec4; 2]>> {
    let used = |i: usize| scene.materials.iter().any(|m| m.albedo_texture.as_ref().is_some_and(|s| s.texture == i));
    (0..scene.textures.len())
        .into_par_iter()
        .map(|i| {
            let texture = &scene.textures[i];
            let mut texels = (0..texture.height).flat_map(|y| (0..texture.width).map(move |x| texture.texel(x, y)));
            let first = if used(i) { texels.next()? } else { return None };
            Some(texels.fold([first, first], |[low, high], v| [low.min(v), high.max(v)]))
        })
        .collect()
}

/// Emitted radiance of a triangle [nit], averaged over points spread evenly on it.
fn mean_emission(scene: &Scene, mesh: &Mesh, triangle: usize, material: &Material) -> Rgb {
    let factor = material.emission;
    let textured = |slot: &TextureSlot| {
        let texture = scene.textures.get(slot.texture)?;
        let uvs = mesh.uv_set(&slot.uv_set)?;
        let [a, b, c] = mesh.triangles[triangle].map(|v| slot.image_from_uv.transform_point2(uvs[v as usize]));
        let value = |uv: Vec2| (texture.sample(uv, slot.wrap) * slot.scale + slot.bias).truncate();
        // Centroids of the EMISSION_STEPS^2 congruent triangles that the triangle divides into.
        let step = 1.0 / EMISSION_STEPS as f32;
        let (mut sum, mut count) = (Rgb::ZERO, 0.0);
        for i in 0..EMISSION_STEPS {
            for j in 0..EMISSION_STEPS - i {
                for (third, inside) in [(1.0 / 3.0, true), (2.0 / 3.0, i + j + 1 < EMISSION_STEPS)] {
                    if inside {
                        let (u, v) = ((i as f32 + third) * step, (j as f32 + third) * step);
                        sum += value(a + (b - a) * u + (c - a) * v);
                        count += 1.0;
                    }
                }
            }
        }
        Some(sum / count)
    };
    factor * material.emission_texture.as_ref().and_then(textured).unwrap_or(Rgb::ONE).max(Rgb::ZERO)
}

/// Corners of the box around all surfaces [m].
fn bounds(scene: &Scene) -> [Vec3; 2] {
    let corners = (0..scene.surfaces.len()).into_par_iter().map(|i| {
        let count = scene.meshes[scene.surfaces[i].mesh].triangles.len();
        let points = (0..count).flat_map(|t| scene.world_triangle(i, t));
        points.fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], p| [low.min(p), high.max(p)])
    });
    let join = |a: [Vec3; 2], b: [Vec3; 2]| [a[0].min(b[0]), a[1].max(b[1])];
    corners.reduce(|| [Vec3::INFINITY, Vec3::NEG_INFINITY], join)
}

fn environment_info(scene: &Scene, sky: &Environment) -> EnvironmentInfo {
    let texture = sky.texture.and_then(|t| scene.textures.get(t));
    let texture = texture.map(|t| (t.name.clone(), [t.width, t.height]));
    EnvironmentInfo { name: sky.name.clone(), radiance: sky.radiance.to_array(), texture }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texels_follow_the_density_until_the_pages_are_full() {
        let dense = |density| Settings {
            density: Some(density),
            page_size: Some(64),
            max_pages: Some(2),
            ..Settings::default()
        };
        let e = estimate(2.0, &dense(10.0));
        assert_eq!((e.texels, e.pages, e.density), (200, 1, 10.0));
        let e = estimate(2.0, &dense(1000.0));
        assert_eq!(e.pages, 2);
        assert!((e.density.powi(2) * 2.0 - e.texels as f64).abs() < 1.0 && e.texels <= 2 * 64 * 64);
        let e = estimate(3.0, &Settings { resolution: Some(256), ..Settings::default() });
        assert_eq!((e.pages, e.page_size), (1, 256));
    }
}
