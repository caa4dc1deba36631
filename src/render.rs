//! Pictures of a scene through a camera, by any of the methods that follow rays.

mod camera;
mod hurry;
mod output;

use crate::added_light;
use crate::error::{Error, Result, Warnings};
use crate::integrate::World;
use crate::light::Lights;
use crate::limits;
use crate::load::baked::{BakedLight, add_sky, baked_light};
use crate::load::{self, Loaded};
use crate::measure::{measure, measure_bake};
use crate::medium::Media;
use crate::progress::Progress;
use crate::report::Clock;
use crate::scatter::{self, Scattering, Surfaces};
use crate::scene::{Camera, Scene};
use crate::sensor::{Film, View};
use crate::settings::Settings;
use crate::trace::Tracer;
use camera::choose;
use glam::Vec3;
use hurry::Hurry;
use output::Output;
use std::path::{Path, PathBuf};

/// A picture as it is asked for.
#[derive(Clone, Debug)]
pub struct Picture {
    pub camera: CameraChoice,
    /// Pixels in a row.
    pub width: u32,
    /// Rows; none: as the camera's shape has it.
    pub height: Option<u32>,
    /// Whose light is seen.
    pub light: LightChoice,
    /// Stops by which the PNG is brighter than its middle at a middle grey.
    pub exposure: f32,
}

/// Whose picture it is.
#[derive(Clone, Debug, PartialEq)]
pub enum CameraChoice {
    /// The scene's first camera.
    First,
    /// The scene's camera of this name, or whose name ends with it after a slash.
    Named(String),
    /// A place to stand, a place to look at, and the vertical angle of view [degrees].
    At(Vec3, Vec3, f32),
}

/// Whose light a picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightChoice {
    /// A bake's, where the file has one, else that of the method.
    Any,
    /// That of the method.
    Traced,
    /// A bake's, by a final gather.
    Gathered,
}

/// How a picture came out.
#[derive(Clone, Debug)]
pub struct Rendered {
    pub size: [u32; 2],
    /// Walks from each pixel, or from each square of pixels.
    pub samples: u64,
    /// Side of the squares that are sampled as one [pixels]: 1, unless the time was too short for a sample of each pixel.
    pub side: u32,
    /// Root mean square of the pixels' standard errors over their mean; `None` where nothing is known of them: of one sample, or of a
    /// black picture.
    pub noise: Option<f64>,
    /// The picture and its tone-mapped form.
    pub files: [PathBuf; 2],
    pub warnings: Warnings,
}

/// The ratio of width to height where neither a camera nor a height says one.
const ASPECT: f32 = 16.0 / 9.0;

/// Takes a picture of the scene file `scene`, and writes it to `output` (.exr), and as a PNG of the same name beside it: as it grows, and
/// at the end. The folder is made where it is missing.
///
/// # Errors
/// Those of the loader; `Invalid` where there is no such camera, nothing shines, the picture takes more memory than there is, or a file is in
/// the way; `Io`; `Cancelled`: what was written by then stays.
pub fn render(
    scene: &Path,
    output: &Path,
    settings: &Settings,
    picture: &Picture,
    progress: &dyn Progress,
) -> Result<Rendered> {
    // Budgets of time are kept by this clock, whether the caller's progress knows the time or not.
    let clock = Clock::new(progress);
    settings.check()?;
    clock.begin("load", 0);
    let mut loaded = load::load_with(scene, &settings.load_options())?;
    added_light::add(&mut loaded, settings)?;
    add_sky(&mut loaded, picture.light != LightChoice::Any)?;
    let camera = choose(&mut loaded, &picture.camera)?;
    let size = size(&camera, picture);
    let bake = bake(&mut loaded, picture.light)?;
    limits::check_picture(&loaded, size, settings)?;
    if bake.is_none() {
        refuse_darkness(&loaded)?;
    }
    refuse_input(&loaded, output)?;
    let view = View::new(camera, size[0], size[1]);
    let mut result = Output::new(output, size, picture.exposure)?;
    let bake = bake.as_ref().map(|light| (light, picture.light == LightChoice::Gathered));
    let (film, side) = expose(&mut loaded.scene, &view, settings, bake, &mut result, &clock)?;
    clock.begin("write", 0);
    result.write(&film, view.in_squares(side).size(), &clock)?;
    let mut warnings = loaded.warnings;
    warn(&film, side, &mut warnings);
    let noise = film.knows_noise().then(|| film.noise());
    Ok(Rendered { size, samples: film.passes(), side, noise, files: result.files, warnings })
}

/// Refuses a scene in which nothing shines, as a bake does; what a bake leaves to the engine shines in a picture.
fn refuse_darkness(loaded: &Loaded) -> Result<()> {
    let scene = &loaded.scene;
    let shines = scene.has_light() || !scene.lights.is_empty() || scene.environment.is_some();
    match (shines, scene.surfaces.is_empty()) {
        (true, _) => Ok(()),
        (false, true) => Err(Error::invalid(loaded.path().display(), "the scene is empty; there is nothing to see")),
        (false, false) => Err(Error::invalid(loaded.path().display(), added_light::NO_LIGHT)),
    }
}

/// Says where a picture is not what was hoped for.
fn warn(film: &Film, side: u32, warnings: &mut Warnings) {
    if film.is_black() {
        let message = "the camera sees nothing that is lit; see where it stands and what shines with `lumel inspect`, or give another \
                       --camera";
        warnings.add("picture", message);
    }
    if side > 1 {
        let message = format!(
            "the time is too short for a sample of each pixel: squares of {side} x {side} pixels were sampled as one; give more time, or a \
             smaller --size"
        );
        warnings.add("--time-budget", message);
    }
}

/// The bake that is to be seen.
fn bake(loaded: &mut Loaded, choice: LightChoice) -> Result<Option<BakedLight>> {
    if choice == LightChoice::Traced {
        return Ok(None);
    }
    let light = baked_light(loaded)?;
    if light.is_none() && choice == LightChoice::Gathered {
        let message = "names no lightmaps for a final gather; give the <stem>.glb of a bake";
        return Err(Error::invalid(loaded.path().display(), message));
    }
    Ok(light)
}

/// What the view measures, shown as it grows; of a bake, by a final gather or as it is. With the side of the squares of pixels that are
/// sampled as one, where there is no time for each.
fn expose(
    scene: &mut Scene,
    view: &View,
    settings: &Settings,
    bake: Option<(&BakedLight, bool)>,
    output: &mut Output,
    progress: &dyn Progress,
) -> Result<(Film, u32)> {
    // A bake knows diffuse surfaces alone.
    let surfaces = if bake.is_some() { Surfaces::Diffuse } else { settings.surfaces };
    scatter::adapt(scene, surfaces);
    let scene = &*scene;
    let tracer = Tracer::new(scene);
    // What a bake leaves to the engine shines in a picture all the same.
    let lights = Lights::of(scene, |_| true);
    let scattering = Scattering::new(scene, surfaces);
    let media = Media::new(scene);
    let world = World::new(scene, &tracer, &lights, &scattering, &media);
    let mut take = |view: &View, progress: &dyn Progress| {
        let show = |film: &Film| output.show(film, view.size(), progress);
        match bake {
            Some((light, gathers)) => measure_bake(&world, light, view, gathers, settings, progress, show),
            None => measure(&world, view, settings, progress, show),
        }
    };
    let pixels = view.size().map(u64::from).iter().product();
    let hurry = Hurry::new(progress, settings.time_budget, pixels);
    match take(view, &hurry) {
        Err(Error::Cancelled) if !progress.cancelled() => {
            let side = hurry.side();
            take(&view.in_squares(side), progress).map(|film| (film, side))
        }
        taken => taken.map(|film| (film, 1)),
    }
}

/// Width and height [pixels].
fn size(camera: &Camera, picture: &Picture) -> [u32; 2] {
    let height = picture.height.unwrap_or_else(|| {
        let aspect = camera.aspect.unwrap_or(ASPECT);
        ((picture.width as f32 / aspect).round() as u32).max(1)
    });
    [picture.width, height]
}

/// Refuses to replace an input.
fn refuse_input(loaded: &Loaded, output: &Path) -> Result<()> {
    for file in [output.to_path_buf(), output.with_extension("png")] {
        let Ok(there) = file.canonicalize() else { continue };
        let inputs = loaded.inputs.iter().map(PathBuf::as_path).chain([loaded.path()]);
        if inputs.filter_map(|input| input.canonicalize().ok()).any(|input| input == there) {
            return Err(Error::invalid(file.display(), "would be replaced by the picture; give another file with -o"));
        }
    }
    Ok(())
}
