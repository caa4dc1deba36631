//! `lumel bake` and `lumel unwrap`: the commands that run the pipeline and write a folder.

use super::args::{BakeArgs, UnwrapArgs};
use super::config::{self, Resolved, Typed};
use super::console::Console;
use super::failure::Failure;
use super::{destination, interrupt};
use lumel::pipeline::{self, Report};
use lumel::progress::Progress;
use lumel::settings::Settings;
use lumel::{Error, Result};
use std::path::Path;
use std::time::Instant;

/// Stack of the worker threads [bytes]. The pipeline itself runs on one of them, and readers recurse over the depth of the
/// scene; the default of 2 MiB is a quarter of what the main thread would have had.
const STACK_SIZE: usize = 16 << 20;

/// `lumel bake`.
pub fn bake(args: &BakeArgs, console: &Console) -> std::result::Result<(), Failure> {
    run(args, args.output.as_deref(), !args.cache.no_cache, console, pipeline::bake)
}

/// `lumel unwrap`.
pub fn unwrap(args: &UnwrapArgs, console: &Console) -> std::result::Result<(), Failure> {
    run(args, args.output.as_deref(), false, console, pipeline::unwrap)
}

fn run(
    args: &impl Typed,
    output: Option<&Path>,
    remembers: bool,
    console: &Console,
    job: impl Fn(&Path, &Path, &Settings, &dyn Progress) -> Result<Report> + Sync,
) -> std::result::Result<(), Failure> {
    let scene = args.scene().scene.as_path();
    let Resolved { mut settings, file } = config::resolve(args)?;
    let folder = destination::folder(scene, output);
    settings.cache = if remembers { settings.cache.or_else(|| Some(destination::cache(&folder))) } else { None };
    work_on(scene, file.as_deref(), &folder, &settings, console, job)
}

/// Does `job` on the scene file `scene`, into the folder `folder`, and tells of it; `config` is the settings file that was read.
///
/// # Errors
/// Those of the job; `Invalid` where it would replace an input.
pub fn work_on(
    scene: &Path,
    config: Option<&Path>,
    folder: &Path,
    settings: &Settings,
    console: &Console,
    job: impl Fn(&Path, &Path, &Settings, &dyn Progress) -> Result<Report> + Sync,
) -> std::result::Result<(), Failure> {
    let start = Instant::now();
    let inputs: Vec<&Path> = [Some(scene), config, settings.environment.as_deref()].into_iter().flatten().collect();
    destination::refuse_replacing(scene, &inputs, folder)?;

    interrupt::install(console, console.cancel_flag(), Some(folder.to_path_buf()));
    // A stage that fails isn't said to be done: the error takes its place.
    let report = workers(settings)?.install(|| job(scene, folder, settings, console))?;
    console.finish();
    console.warnings(&report.warnings);
    if settings.shard.is_some() {
        return Ok(());
    }
    console.done(folder, &report.summary(), start.elapsed().as_secs_f64());
    Ok(())
}

/// The threads that all work runs on.
///
/// # Errors
/// `Invalid` where the system refuses them.
pub fn workers(settings: &Settings) -> Result<rayon::ThreadPool> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(settings.threads.unwrap_or(0))
        .stack_size(STACK_SIZE)
        .thread_name(|i| format!("lumel-{i}"))
        .build()
        .map_err(|e| Error::invalid("--threads", e))
}
