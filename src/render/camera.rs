//! The camera that a picture is taken through.

use super::CameraChoice;
use crate::error::{Error, Result};
use crate::load::Loaded;
use crate::scene::Camera;

/// The camera that is asked for.
///
/// # Errors
/// `Invalid` where there is none, or it looks nowhere.
pub fn choose(loaded: &mut Loaded, choice: &CameraChoice) -> Result<Camera> {
    let scene = &loaded.scene;
    let names = || scene.cameras.iter().map(|c| c.name.as_str()).collect::<Vec<_>>().join(", ");
    match choice {
        CameraChoice::At(_, _, angle) if !(*angle > 0.0 && *angle < 180.0) => {
            let message = format!("the angle of view is {angle} degrees; give one of more than 0 and less than 180");
            Err(Error::invalid("--camera", message))
        }
        CameraChoice::At(eye, target, angle) => Camera::look_at(*eye, *target, angle.to_radians()).ok_or_else(|| {
            let message = format!("looks nowhere: from {eye} to {target}; give two places that differ");
            Error::invalid("--camera", message)
        }),
        CameraChoice::First => scene.cameras.first().cloned().ok_or_else(|| {
            let [low, high] = scene.bounds().unwrap_or_default();
            let message = format!(
                "the scene has no camera; give one with --camera X,Y,Z,TARGET_X,TARGET_Y,TARGET_Z,ANGLE (the scene reaches from \
                 {low:.2} to {high:.2} m, Y up)"
            );
            Error::invalid(loaded.path().display(), message)
        }),
        CameraChoice::Named(name) => {
            let is_named = |c: &&Camera| c.name == *name || c.name.rsplit('/').next() == Some(name);
            let taken = scene.cameras.iter().find(is_named).cloned();
            // Readers number what has one name: camera, camera#2.
            let last = |c: &Camera| c.name.rsplit('/').next().unwrap_or_default().to_string();
            let is_alike = |c: &&Camera| c.name == *name || last(c).split('#').next() == Some(name);
            let alike: Vec<&str> = scene.cameras.iter().filter(is_alike).map(|c| c.name.as_str()).collect();
            if let Some(taken) = taken.as_ref().filter(|_| alike.len() > 1) {
                let message = format!(
                    "{} cameras have this name ({}); {} was taken: give another's whole name",
                    alike.len(),
                    alike.join(", "),
                    taken.name
                );
                loaded.warnings.add(format!("--camera {name}"), message);
            }
            taken.ok_or_else(|| {
                let message = match scene.cameras.is_empty() {
                    true => format!("there is no camera {name}, nor any other; give places and an angle"),
                    false => format!("there is no camera {name}; there are: {}", names()),
                };
                Error::invalid(loaded.path().display(), message)
            })
        }
    }
}
