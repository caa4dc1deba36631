//! `lumel render`: a picture of a scene through a camera.

use super::args::RenderArgs;
use super::bake::workers;
use super::config::{self, Resolved};
use super::console::Console;
use super::failure::Failure;
use super::{destination, interrupt};
use lumel::Error;
use lumel::render::{CameraChoice, LightChoice, Picture, render as take};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// `lumel render`.
///
/// # Errors
/// `Usage` where the settings are wrong, else the library's.
pub fn render(args: &RenderArgs, console: &Console) -> Result<(), Failure> {
    let start = Instant::now();
    let scene = args.scene.scene.as_path();
    let Resolved { settings, file } = config::resolve(args)?;
    let output = args.output.clone().unwrap_or_else(|| PathBuf::from(format!("{}.exr", destination::stem(scene))));
    let is_config = |f: &PathBuf| matches!((f.canonicalize(), output.canonicalize()), (Ok(a), Ok(b)) if a == b);
    if let Some(config) = file.filter(is_config) {
        let message = "would be replaced by the picture; give another file with -o";
        return Err(Error::invalid(config.display(), message).into());
    }
    let picture = Picture {
        camera: args.view.camera.clone().unwrap_or(CameraChoice::First),
        width: args.view.size.map_or(WIDTH, |(width, _)| width),
        height: args.view.size.and_then(|(_, height)| height),
        light: match (args.final_gather, &args.walk.method) {
            (true, _) => LightChoice::Gathered,
            (false, Some(_)) => LightChoice::Traced,
            (false, None) => LightChoice::Any,
        },
        exposure: args.view.exposure,
    };
    let folder = output.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    interrupt::install(console, console.cancel_flag(), Some(folder.to_path_buf()));
    let rendered = workers(&settings)?.install(|| take(scene, &output, &settings, &picture, console))?;
    console.finish();
    console.warnings(&rendered.warnings);
    let [width, height] = rendered.size;
    let summary = [
        match rendered.side {
            1 => format!("{width} x {height} pixels, {} samples each", rendered.samples),
            side => format!("{width} x {height} pixels, {} samples of each {side} x {side} of them", rendered.samples),
        },
        match rendered.noise {
            Some(noise) => format!("noise {:.2} % of the mean", 100.0 * noise),
            None => "noise unknown".to_string(),
        },
        format!("{} shows it", rendered.files[1].display()),
    ];
    console.done(&output, &summary, start.elapsed().as_secs_f64());
    Ok(())
}

/// Pixels in a row, unless said otherwise.
const WIDTH: u32 = 960;
