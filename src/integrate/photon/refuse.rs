//! What photons can't follow.

use super::PhotonParams;
use crate::error::{Error, Result};
use crate::integrate::World;
use crate::scene::{Light, LightShape};

/// Refuses what light can't set out from as it should, by name.
pub fn check(world: &World, params: &PhotonParams) -> Result<()> {
    if params.radius.is_some_and(|radius| !(radius > 0.0 && radius.is_finite())) {
        return Err(Error::invalid("photon radius", "must be a length greater than 0"));
    }
    if params.photons == Some(0) {
        return Err(Error::invalid("photons", "must be 1 at least"));
    }
    check_lights(world)?;
    match world.scene.media.iter().find(|medium| medium.emission.max_element() > 0.0) {
        Some(medium) => {
            Err(Error::unsupported(&medium.name, "photons don't set out from media that shine; choose the method path"))
        }
        None => Ok(()),
    }
}

/// Refuses portals and links, by the light's name.
pub fn check_lights(world: &World) -> Result<()> {
    let lights = &world.lights;
    let polygons = lights.polygons.polygons.iter().filter_map(|polygon| match polygon.source {
        crate::light::polygon::Source::Light { light, .. } => Some(light),
        crate::light::polygon::Source::Surface { .. } => None,
    });
    let of_scene: Vec<&Light> = lights
        .delta
        .iter()
        .map(|delta| delta.number())
        .chain(polygons)
        .map(|number| &world.scene.lights[number])
        .collect();
    if let Some(light) = of_scene.iter().find(|light| !light.links.are_all()) {
        let message = "photons know no lights that only some surfaces are lit or shadowed by; choose the method path";
        return Err(Error::unsupported(&light.name, message));
    }
    let is_portal = |light: &&Light| matches!(light.shape, LightShape::Portal { .. });
    let portal = of_scene.iter().copied().find(|light| is_portal(light));
    if portal.is_some() || !lights.portals.is_empty() {
        let any = || world.scene.lights.iter().find(is_portal);
        let name = portal.or_else(any).map_or("portal", |light| light.name.as_str());
        return Err(Error::unsupported(name, "photons don't set out from portals; choose the method path"));
    }
    Ok(())
}
