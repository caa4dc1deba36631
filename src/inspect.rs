//! What a bake would see: surfaces with their areas, lights with their units, texels at the density asked for.
//!
//! Areas are sums over world-space triangles in f64. Power is `pi L A` of Lambertian emitters and the integral of the
//! intensity of point lights; it is what leaves the light, before anything blocks it. Cost: one pass over the triangles and
//! over the texels of the textures in use.
//!
//! As JSON (`lumel inspect --json`) an [`Inspection`] is one object whose keys are the fields below, in order; a quantity's unit
//! stands in its field's comment, what is absent is null, colours are three numbers R G B (linear Rec.709).

mod doubt;
mod light;

pub use doubt::doubts;

use crate::color::{Rgb, luminance};
use crate::error::Warnings;
use crate::load::Loaded;
use crate::patch::reflectance::MOST_ALBEDO;
use crate::scene::{Alpha, BakeMode, Environment, Material, Mesh, Scene, Surface, TextureSlot};
use crate::settings::Settings;
use crate::unwrap::{Density, Share};
use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
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
    pub limits: Limits,
    /// What was skipped or replaced, and what looks wrong.
    pub warnings: Warnings,
}

/// What a bake does not go beyond.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Limits {
    /// Largest page [texels], square, and most pages that are written.
    pub page_size: u32,
    pub max_pages: u32,
    /// The highest albedo that is baked; whiter ones are taken as this.
    pub most_albedo: f32,
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
    /// Lowest and highest opacity of its materials, without their textures [0..1]; `masked` where some have holes by a cutoff.
    pub opacity: [f32; 2],
    pub masked: bool,
    /// Highest transmission of its materials by channel, without their textures [0..1].
    pub transmission: [f32; 3],
    /// True where all of its materials reflect on both sides.
    pub double_sided: bool,
    /// `lit`, or what differs: `casts only`, `receives only`, `vertex colours`, ... ([`crate::scene::role`]).
    pub role: &'static str,
    /// About how fine it would be [texels per metre], and how many texels it would cover; on hidden pages where its role
    /// shows none.
    pub density: f64,
    pub texels: u64,
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
    /// What of its light is baked: `baked`, `indirect` or `dynamic`; and its light group.
    pub bake: BakeMode,
    pub group: Option<String>,
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
    /// As of lights.
    pub bake: BakeMode,
    pub group: Option<String>,
}

/// How many texels a bake would have, about: packing is not tried.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
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
    let mut surfaces: Vec<SurfaceInfo> =
        (0..scene.surfaces.len()).into_par_iter().map(|i| surface_info(scene, i, &ranges)).collect();
    let area = surfaces.iter().map(|s| s.area).sum();
    let areas: Vec<f64> = surfaces.iter().map(|s| s.area).collect();
    let (estimate, densities) = estimate(scene, &areas, settings);
    for (info, density) in surfaces.iter_mut().zip(densities) {
        (info.density, info.texels) = (density, (info.area * density * density).round() as u64);
    }
    let mut warnings = loaded.warnings.clone();
    warnings.extend(doubts(scene));
    let params = settings.unwrap_params();
    let mut uses = vec![0; scene.meshes.len()];
    scene.surfaces.iter().for_each(|s| uses[s.mesh] += 1);
    let shared = scene.meshes.iter().zip(uses).filter(|(_, n)| *n > 1);
    Inspection {
        shared_meshes: shared.map(|(m, surfaces)| SharedMesh { name: m.name.clone(), surfaces }).collect(),
        lights: scene.lights.iter().map(|light| light::light_info(scene, light)).collect(),
        environment: scene.environment.iter().flat_map(Environment::each).map(|e| environment_info(scene, e)).collect(),
        has_light: scene.has_light(),
        bounds: scene.bounds().unwrap_or([Vec3::INFINITY, Vec3::NEG_INFINITY]).map(|p| p.to_array()),
        triangles: scene.triangle_count(),
        area,
        emissive_area: surfaces.iter().map(|s| s.emissive_area).sum(),
        emissive_power: surfaces.iter().map(|s| s.emissive_power).sum(),
        estimate,
        limits: Limits {
            page_size: settings.resolution.unwrap_or(params.page_size),
            max_pages: if settings.resolution.is_some() { 1 } else { params.max_pages },
            most_albedo: MOST_ALBEDO,
        },
        surfaces,
        warnings,
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
    estimate(scene, &areas, settings).0
}

/// Texels and pages for surfaces of `areas` [m^2], and the density of each.
fn estimate(scene: &Scene, areas: &[f64], settings: &Settings) -> (Estimate, Vec<f64>) {
    let params = settings.unwrap_params();
    let (count, page_size, most) = match params.density {
        Density::FillPage(n) => (PACKING * f64::from(n).powi(2), n, 1),
        Density::TexelCount(n) => (n as f64, params.page_size, u64::from(params.max_pages.max(1))),
        Density::TexelsPerMetre(_) => (0.0, params.page_size, u64::from(params.max_pages.max(1))),
    };
    let asked = match params.density {
        Density::TexelsPerMetre(density) => f64::from(density),
        _ => density_for(scene, areas, count),
    };
    let per_page = PACKING * f64::from(page_size).powi(2);
    let shown = || scene.surfaces.iter().zip(areas).filter(|(s, _)| s.role.is_shown());
    let texels: f64 = shown().map(|(s, area)| area * share(s, asked).powi(2)).sum();
    let pages = ((texels / per_page).ceil() as u64).clamp(1, most);
    // More than fit on the pages: the density falls until they do.
    let fitting = (pages as f64 * per_page).min(texels);
    let lowered = if texels > 0.0 { (fitting / texels).sqrt() } else { 1.0 };
    let estimate = Estimate { density: asked * lowered, texels: fitting.round() as u64, pages, page_size };
    (estimate, scene.surfaces.iter().map(|s| share(s, asked) * lowered).collect())
}

/// The density of a surface where the bake has `density`.
fn share(surface: &Surface, density: f64) -> f64 {
    Share::of(&surface.role).at(density, density)
}

/// The density at which shown surfaces of `areas` have `count` texels; 1 keeps the numbers finite where there is no area.
fn density_for(scene: &Scene, areas: &[f64], count: f64) -> f64 {
    let shown = scene.surfaces.iter().zip(areas).filter(|(s, _)| s.role.is_shown());
    let density = Share::density_of(shown.map(|(s, area)| (*area, Share::of(&s.role))), count);
    if density.is_finite() { density } else { 1.0 }
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
    let used: Vec<&Material> = materials.iter().map(|&m| &scene.materials[m as usize]).collect();
    let opacities = used.iter().map(|m| match m.alpha {
        Alpha::Opaque => 1.0,
        Alpha::Mask { opacity, .. } | Alpha::Blend { opacity } => opacity,
    });
    let opacity = opacities.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], o| [low.min(o), high.max(o)]);
    SurfaceInfo {
        name: surface.name.clone(),
        mesh: mesh.name.clone(),
        triangles: mesh.triangles.len(),
        area,
        albedo: albedo.map(|c| c.to_array()),
        opacity,
        masked: used.iter().any(|m| matches!(m.alpha, Alpha::Mask { .. })),
        transmission: used.iter().fold(Rgb::ZERO, |most, m| most.max(m.transmission)).to_array(),
        double_sided: used.iter().all(|m| m.double_sided),
        role: surface.role.name(),
        density: 0.0,
        texels: 0,
        materials: used.iter().map(|m| m.name.clone()).collect(),
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

fn environment_info(scene: &Scene, sky: &Environment) -> EnvironmentInfo {
    let texture = sky.texture.and_then(|t| scene.textures.get(t));
    let texture = texture.map(|t| (t.name.clone(), [t.width, t.height]));
    EnvironmentInfo {
        name: sky.name.clone(),
        radiance: sky.radiance.to_array(),
        texture,
        bake: sky.contribution.mode(),
        group: sky.contribution.group.as_deref().map(str::to_owned),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Role, SurfaceOrigin};

    fn estimated(areas: &[f64], roles: &[Role], settings: &Settings) -> (Estimate, Vec<f64>) {
        let surface = |role: &Role| Surface {
            name: String::new(),
            mesh: 0,
            world_from_local: glam::Affine3A::IDENTITY,
            origin: SurfaceOrigin::None,
            role: *role,
        };
        let scene = Scene { surfaces: roles.iter().map(surface).collect(), ..Scene::default() };
        estimate(&scene, areas, settings)
    }

    #[test]
    fn texels_follow_the_density_until_the_pages_are_full() {
        let dense = |density| Settings {
            density: Some(density),
            page_size: Some(64),
            max_pages: Some(2),
            ..Settings::default()
        };
        let lit = [Role::default()];
        let (e, _) = estimated(&[2.0], &lit, &dense(10.0));
        assert_eq!((e.texels, e.pages, e.density), (200, 1, 10.0));
        let (e, _) = estimated(&[2.0], &lit, &dense(1000.0));
        assert_eq!(e.pages, 2);
        assert!((e.density.powi(2) * 2.0 - e.texels as f64).abs() < 1.0 && e.texels <= 2 * 64 * 64);
        let (e, _) = estimated(&[3.0], &lit, &Settings { resolution: Some(256), ..Settings::default() });
        assert_eq!((e.pages, e.page_size), (1, 256));
    }

    #[test]
    fn each_surface_has_its_share() {
        let role = Role::default();
        let fine = Role { density_scale: 2.0, ..role };
        let own = Role { density: Some(5.0), ..role };
        let unseen = Role { receives: false, ..role };
        let settings = Settings { density: Some(10.0), ..Settings::default() };
        let (e, densities) = estimated(&[1.0; 4], &[role, fine, own, unseen], &settings);
        assert_eq!(densities, [10.0, 20.0, 5.0, 2.5]);
        assert_eq!(e.texels, 100 + 400 + 25);
    }
}
