//! The lightmaps that a baked GLB names in its extras, to be seen again: see `write/gltf/extras`.

use super::image::{ColorSpace, load_file};
use super::{Loaded, Source};
use crate::color::Rgb;
use crate::error::{Error, Result, Warnings};
use crate::scene::{Environment, Scene, SurfaceOrigin, Texture, Wrap};
use glam::Vec2;
use serde_json::Value;
use std::f32::consts::FRAC_1_PI;
use std::path::Path;

/// A scene's baked light.
pub struct BakedLight {
    /// Each with the factor that makes its values the light that a white diffuse surface sends out [nit], or, where they hold the
    /// albedo, what any surface does.
    pages: Vec<Texture>,
    factor: f32,
    holds_albedo: bool,
    /// Where each surface lies on the pages.
    placements: Vec<Option<Placement>>,
}

/// A surface's part of a page.
struct Placement {
    page: usize,
    uv_set: String,
    scale: Vec2,
    offset: Vec2,
}

/// Reads the baked light of a loaded glTF; `None` where it names no pages.
///
/// # Errors
/// `Invalid` where the extras are malformed, or pages are of a form that can't be read; those of pictures that can't be read.
pub fn baked_light(loaded: &mut Loaded) -> Result<Option<BakedLight>> {
    let Source::Gltf(source) = &loaded.source else { return Ok(None) };
    let Some(root) = source.json.pointer("/asset/extras/lumel") else { return Ok(None) };
    let Some(listed) = root.get("pages").and_then(Value::as_array) else { return Ok(None) };
    let place = source.path.display();
    let folder = source.path.parent().unwrap_or(Path::new(""));
    let mut pages = Vec::new();
    for page in listed {
        let uri = page.get("uri").and_then(Value::as_str).unwrap_or_default();
        let is_read = [".exr", ".hdr"].iter().any(|end| uri.to_ascii_lowercase().ends_with(end));
        if !is_read {
            let message =
                format!("names the page {uri:?}, and only .exr and .hdr pages can be shown; bake with --encoding exr");
            return Err(Error::invalid(&place, message));
        }
        let file = folder.join(uri);
        source.access.check(&file)?;
        pages.push(load_file(&file, ColorSpace::Linear)?);
        loaded.inputs.push(file);
    }
    let (factor, holds_albedo) = match root.get("quantity").and_then(Value::as_str) {
        Some("outgoing") => (1.0, false),
        Some("irradiance") => (FRAC_1_PI, false),
        Some("radiosity") => (FRAC_1_PI, true),
        other => return Err(Error::invalid(&place, format!("its pages hold {other:?}, which isn't known"))),
    };
    let placements = placements(&loaded.scene, &source.json, pages.len(), &mut loaded.warnings);
    Ok(Some(BakedLight { pages, factor, holds_albedo, placements }))
}

/// Gives the scene of a baked GLB the sky that it was baked under, where the file has none of its own: what `asset.extras.lumel.sky` says
/// of it, a radiance [nit]. Of skies with a picture and of other lights it has the names alone, and of suns from the command line the
/// numbers: they are named in a warning, where `is_lit` by what shines, not by the pages.
///
/// # Errors
/// `Invalid` where the extras are malformed.
pub fn add_sky(loaded: &mut Loaded, is_lit: bool) -> Result<()> {
    let Source::Gltf(source) = &loaded.source else { return Ok(()) };
    let place = source.path.display().to_string();
    let Some(lumel) = source.json.pointer("/asset/extras/lumel") else { return Ok(()) };
    for light in lumel.get("missingLights").and_then(Value::as_array).into_iter().flatten().filter(|_| is_lit) {
        let message = "a light that the scene was baked with can't be expressed in the GLB and is missing here; render the scene that was \
                       baked, or show the lightmaps as they are";
        loaded.warnings.add(light.as_str().unwrap_or("light"), message);
    }
    let has_sun = loaded.scene.lights.iter().any(|light| light.name == SUN);
    if let Some(sun) = lumel.get("sun").and_then(Value::as_str).filter(|_| is_lit && !has_sun) {
        let message =
            format!("the sun that the scene was baked with isn't in the file and is missing here; give --sun {sun}");
        loaded.warnings.add(&place, message);
    }
    let Some(sky) = lumel.get("sky").filter(|_| loaded.scene.environment.is_none()) else { return Ok(()) };
    let radiance = sky.get("radiance").and_then(Value::as_array);
    let Some(radiance) = radiance else {
        if !is_lit {
            return Ok(());
        }
        let name = sky.get("name").and_then(Value::as_str).unwrap_or("a picture");
        let message = format!(
            "the sky that the scene was baked under ({name}) isn't in the file and is missing here; give it with --sky or --environment"
        );
        loaded.warnings.add(&place, message);
        return Ok(());
    };
    let channel = |k: usize| radiance.get(k).and_then(Value::as_f64).map(|v| v as f32);
    let rgb = [0, 1, 2].map(|k| channel(k).filter(|v| v.is_finite() && *v >= 0.0));
    let [Some(r), Some(g), Some(b)] = rgb else {
        return Err(Error::invalid(
            place,
            "its extras.lumel.sky is no radiance of three numbers; bake it again, or give a --sky",
        ));
    };
    loaded.scene.environment = Some(Environment::constant("the bake's sky", Rgb::new(r, g, b)));
    Ok(())
}

/// The name of the sun that settings add.
const SUN: &str = "--sun";

/// Where each surface of `scene` lies, as its node says.
fn placements(scene: &Scene, json: &Value, pages: usize, warnings: &mut Warnings) -> Vec<Option<Placement>> {
    let pair = |value: Option<&Value>, default: Vec2| -> Option<Vec2> {
        let Some(value) = value else { return Some(default) };
        let [x, y] = [0, 1].map(|k| value.get(k).and_then(Value::as_f64).map(|v| v as f32));
        Some(Vec2::new(x?, y?)).filter(|v| v.is_finite())
    };
    let read = |node: usize| {
        let lumel = json.get("nodes")?.get(node)?.get("extras")?.get("lumel")?;
        let page = usize::try_from(lumel.get("page")?.as_u64()?).ok().filter(|page| *page < pages)?;
        let set = lumel.get("texCoord").map_or(Some(1), Value::as_u64)?;
        let (scale, offset) = (pair(lumel.get("scale"), Vec2::ONE)?, pair(lumel.get("offset"), Vec2::ZERO)?);
        Some(Placement { page, uv_set: format!("TEXCOORD_{set}"), scale, offset })
    };
    let mut of = |surface: &crate::scene::Surface| {
        let placement = match surface.origin {
            // Instances of a node share its extras, which tell of one of them at most.
            SurfaceOrigin::GltfNode(node) if !surface.name.ends_with(']') => read(node),
            _ => None,
        };
        let has_set = |p: &Placement| scene.meshes[surface.mesh].uv_set(&p.uv_set).is_some();
        let placement = placement.filter(has_set);
        if placement.is_none() {
            warnings.add(&surface.name, "has no place on the baked pages and is shown black");
        }
        placement
    };
    scene.surfaces.iter().map(&mut of).collect()
}

impl BakedLight {
    /// Radiance that a surface of `albedo` sends out, without what it emits, at a point of `triangle` [nit].
    pub fn reflected(&self, scene: &Scene, surface: usize, triangle: usize, at: Vec2, albedo: Rgb) -> Rgb {
        let Some(placement) = &self.placements[surface] else { return Rgb::ZERO };
        let mesh = &scene.meshes[scene.surfaces[surface].mesh];
        let Some(uv) = mesh.uv_set(&placement.uv_set) else { return Rgb::ZERO };
        let [a, b, c] = mesh.triangles[triangle].map(|v| uv[v as usize]);
        let uv = (a + (b - a) * at.x + (c - a) * at.y) * placement.scale + placement.offset;
        let value = self.pages[placement.page].sample(uv, [Wrap::Clamp; 2]).truncate().max(Rgb::ZERO) * self.factor;
        if self.holds_albedo { value } else { albedo * value }
    }

    /// Whether pages hold what surfaces emit, too.
    pub fn holds_emission(&self) -> bool {
        self.holds_albedo
    }
}
