//! Light that settings add to a scene, and media: sun, sky, a picture as the sky, projectors, fog.

use crate::error::{Error, Result};
use crate::light::parts::unite_skies;
use crate::load::Loaded;
use crate::load::access::Access;
use crate::load::image::{self, ColorSpace};
use crate::load::medium::MediumRequest;
use crate::load::pattern::glob;
use crate::load::projector::{ProjectorRequest, Target};
use crate::load::volume;
use crate::scene::clear_sky::{ClearSky, towards};
use crate::scene::{Environment, Light, LightShape, MediumShape};
use crate::settings::{Method, ProjectorSetting, Settings, SkySetting};
use glam::Vec3;
use std::sync::Arc;

/// What to do about a scene in which nothing shines.
pub const NO_LIGHT: &str = "the scene has no light; give it a sky with --sky R,G,B or --environment FILE, or a --sun";

/// The sun's disc [degrees].
const SUN_ANGLE: f32 = 0.53;

/// Adds what `settings` ask for to the loaded scene. A sky takes the place of the scene's own, with a warning.
///
/// # Errors
/// Those of pictures that can't be read.
pub fn add(loaded: &mut Loaded, settings: &Settings) -> Result<()> {
    let replaces = settings.sky.is_some() || settings.environment.is_some();
    if let Some(own) = loaded.scene.environment.as_ref().filter(|_| replaces) {
        loaded.warnings.add(&own.name, "the scene's own sky was replaced by the one that was asked for");
    }
    let sun = settings.sun.map(|[elevation, azimuth, lux]| (towards(elevation, azimuth), lux));
    if let Some((towards_sun, lux)) = sun.filter(|(_, lux)| *lux > 0.0) {
        let shape = LightShape::Directional {
            direction: -towards_sun,
            illuminance: Vec3::splat(lux),
            angle: SUN_ANGLE.to_radians(),
        };
        loaded.scene.lights.push(Light::new("--sun", shape));
    }
    match settings.sky {
        Some(SkySetting::Constant(radiance)) => {
            loaded.scene.environment = Some(Environment::constant("--sky", radiance.into()));
        }
        Some(SkySetting::Clear { turbidity }) => {
            let towards_sun = sun.map_or(Vec3::Y, |(towards_sun, _)| towards_sun);
            loaded.scene.textures.push(ClearSky::new(towards_sun, turbidity).picture());
            picture_sky(loaded, "--sky clear");
        }
        None => {}
    }
    if let Some(picture) = &settings.environment {
        loaded.scene.textures.push(image::load_file(picture, ColorSpace::Auto)?);
        picture_sky(loaded, "--environment");
        loaded.inputs.push(picture.clone());
    }
    settings.projectors.iter().try_for_each(|projector| project(loaded, projector))?;
    for (index, medium) in settings.media.iter().enumerate() {
        fill(loaded, medium, index)?;
    }
    if settings.method == Method::Radiosity {
        for medium in &loaded.scene.media {
            loaded.warnings.add(&medium.name, "radiosity sees no media; choose --method path or photon");
        }
    }
    for light in &mut loaded.scene.lights {
        light.contribution.mode.get_or_insert(settings.bake_lights);
    }
    for sky in unite_skies(&mut loaded.scene) {
        let message = "skies are baked as one; the group and bake mode of the first one hold for this one, too";
        loaded.warnings.add(sky, message);
    }
    Ok(())
}

/// Makes the last texture the sky.
fn picture_sky(loaded: &mut Loaded, name: &str) {
    let texture = Some(loaded.scene.textures.len() - 1);
    loaded.scene.environment = Some(Environment { texture, ..Environment::constant(name, Vec3::ONE) });
}

/// Adds the medium `setting`, number `index` of the settings.
fn fill(loaded: &mut Loaded, setting: &MediumRequest, index: usize) -> Result<()> {
    let name = setting.name.clone().unwrap_or_else(|| format!("medium[{index}]"));
    let invalid = |fault: String| Error::invalid(&name, fault);
    let mut shape = setting.own_shape().map_err(invalid)?;
    let mut grid = None;
    if let Some(path) = &setting.grid {
        // Settings are the user's own: any file may be named, of a size that is read at once.
        let bytes = Access::default().read(path)?;
        let volume = volume::read(&path.display().to_string(), &bytes, None)?;
        if let (MediumShape::Scene, None, Some(placed)) = (shape, setting.shape, volume.file_from_unit) {
            shape = MediumShape::Box { world_from_unit: placed.as_affine3a() };
        }
        grid = Some(Arc::new(volume.grid));
        loaded.inputs.push(path.clone());
    }
    let mut medium = setting.medium(&name, shape).map_err(invalid)?;
    medium.grid = grid;
    match medium.fault(&loaded.scene) {
        Some(fault) => Err(invalid(fault)),
        None => {
            loaded.scene.media.push(medium);
            Ok(())
        }
    }
}

/// Lets the lights that `setting` names throw its picture.
fn project(loaded: &mut Loaded, setting: &ProjectorSetting) -> Result<()> {
    let scene = &mut loaded.scene;
    let lights: Vec<usize> = (0..scene.lights.len()).filter(|&l| glob(&setting.light, &scene.lights[l].name)).collect();
    if lights.is_empty() {
        loaded.warnings.add(&setting.light, "a projector names no light of the scene; nothing is thrown");
        return Ok(());
    }
    scene.textures.push(image::load_file(&setting.picture, ColorSpace::Auto)?);
    loaded.inputs.push(setting.picture.clone());
    let texture = scene.textures.len() - 1;
    let target = setting.target.as_ref().map_or(Target::None, |name| {
        let surfaces = (0..scene.surfaces.len()).filter(|&s| glob(name, &scene.surfaces[s].name)).collect();
        Target::Surfaces { name: name.clone(), surfaces }
    });
    let fov = setting.fov.map(f32::to_radians);
    for light in lights {
        let request = ProjectorRequest { light, texture, fov, aspect: setting.aspect, target: target.clone() };
        request.apply(scene, &mut loaded.warnings);
    }
    Ok(())
}
