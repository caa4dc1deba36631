//! Pictures of a scene through a camera, by any of the methods that follow rays.

use crate::added_light;
use crate::color::Rgb;
use crate::error::{Error, Result, Warnings};
use crate::integrate::World;
use crate::light::Lights;
use crate::load::baked::{BakedLight, baked_light};
use crate::load::{self, Loaded};
use crate::measure::{measure, measure_bake};
use crate::medium::Media;
use crate::progress::Progress;
use crate::scatter::{self, Scattering, Surfaces};
use crate::scene::{Camera, Scene};
use crate::sensor::{Film, View};
use crate::settings::Settings;
use crate::trace::Tracer;
use crate::write::output::Staging;
use crate::write::picture::{Tone, write_picture};
use glam::Vec3;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

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
    /// Walks from each pixel.
    pub samples: u64,
    /// Root mean square of the pixels' standard errors over their mean.
    pub noise: f64,
    /// The picture and its tone-mapped form.
    pub files: [PathBuf; 2],
    pub warnings: Warnings,
}

/// The ratio of width to height where neither a camera nor a height says one.
const ASPECT: f32 = 16.0 / 9.0;

/// The least time from one preview to the next.
const PREVIEW: Duration = Duration::from_secs(2);

/// Takes a picture of the scene file `scene`, and writes it to `output` (.exr), and as a PNG of the same name beside it: as it grows, and
/// at the end.
///
/// # Errors
/// Those of the loader; `Invalid` where there is no such camera, nothing shines or a file is in the way; `Io`; `Cancelled`.
pub fn render(
    scene: &Path,
    output: &Path,
    settings: &Settings,
    picture: &Picture,
    progress: &dyn Progress,
) -> Result<Rendered> {
    settings.check()?;
    progress.begin("load", 0);
    let mut loaded = load::load_with(scene, &settings.load_options())?;
    added_light::add(&mut loaded, settings)?;
    let camera = choose(&loaded, &picture.camera)?;
    let size = size(&camera, picture);
    if loaded.scene.surfaces.is_empty() && !loaded.scene.has_light() {
        return Err(Error::invalid(scene.display(), "the scene is empty; there is nothing to see"));
    }
    let bake = bake(&mut loaded, picture.light)?;
    refuse_input(&loaded, output)?;
    let view = View::new(camera, size[0], size[1]);
    let result = Output::new(output, size, picture.exposure)?;
    let gathers = picture.light == LightChoice::Gathered;
    let film =
        expose(&mut loaded.scene, &view, settings, bake.as_ref().map(|light| (light, gathers)), &result, progress)?;
    result.write(&film)?;
    Ok(Rendered { size, samples: film.passes(), noise: film.noise(), files: result.files, warnings: loaded.warnings })
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

/// What the view measures, shown as it grows; of a bake, by a final gather or as it is.
fn expose(
    scene: &mut Scene,
    view: &View,
    settings: &Settings,
    bake: Option<(&BakedLight, bool)>,
    output: &Output,
    progress: &dyn Progress,
) -> Result<Film> {
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
    let mut shown = Instant::now();
    let show = |film: &Film| {
        if shown.elapsed() < PREVIEW {
            return Ok(());
        }
        shown = Instant::now();
        output.write(film)
    };
    match bake {
        Some((light, gathers)) => measure_bake(&world, light, view, gathers, settings, progress, show),
        None => measure(&world, view, settings, progress, show),
    }
}

/// The camera that is asked for.
fn choose(loaded: &Loaded, choice: &CameraChoice) -> Result<Camera> {
    let scene = &loaded.scene;
    let names = || scene.cameras.iter().map(|c| c.name.as_str()).collect::<Vec<_>>().join(", ");
    match choice {
        CameraChoice::At(eye, target, angle) => Camera::look_at(*eye, *target, angle.to_radians()).ok_or_else(|| {
            Error::invalid("--camera", "looks nowhere: give two places, and an angle of more than 0 and less than 180")
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
            scene.cameras.iter().find(is_named).cloned().ok_or_else(|| {
                let message = match scene.cameras.is_empty() {
                    true => format!("there is no camera {name}, nor any other; give places and an angle"),
                    false => format!("there is no camera {name}; there are: {}", names()),
                };
                Error::invalid(loaded.path().display(), message)
            })
        }
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

/// Where a picture goes.
struct Output {
    folder: PathBuf,
    files: [PathBuf; 2],
    size: [u32; 2],
    exposure: f32,
}

impl Output {
    /// Makes sure that the folder can be written.
    fn new(output: &Path, size: [u32; 2], exposure: f32) -> Result<Self> {
        let folder = output.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_path_buf();
        if output.file_name().is_none() || output.extension().is_none_or(|e| !e.eq_ignore_ascii_case("exr")) {
            return Err(Error::invalid(output.display(), "is no .exr file; give one with -o"));
        }
        if !folder.is_dir() {
            return Err(Error::invalid(folder.display(), "is no folder; make it first, or give another file with -o"));
        }
        Staging::new(&folder)?;
        Ok(Self { folder, files: [output.to_path_buf(), output.with_extension("png")], size, exposure })
    }

    /// Puts what is on `film` in the place of what was there.
    fn write(&self, film: &Film) -> Result<()> {
        let rgb: Vec<Rgb> = film.mean();
        let mut staging = Staging::new(&self.folder)?;
        let mut place = |file: &PathBuf| staging.path(file.file_name().unwrap_or_default());
        let (exr, png) = (place(&self.files[0])?, place(&self.files[1])?);
        write_picture(&exr, &png, self.size, &rgb, Tone::of(&rgb, self.exposure))?;
        staging.commit()
    }
}
