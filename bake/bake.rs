//! `lumel bake` and `lumel unwrap`: the commands that run the pipeline and write a folder.

use super::args::{BakeArgs, UnwrapArgs};
use super::config::{self, Resolved, Typed};
use super::console::Console;
use super::failure::Failure;
use super::{destination, interrupt, plan};
use lumel::pipeline::{self, Report};
use lumel::progress::Progress;
use lumel::settings::Settings;
use lumel::{Error, Result};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Stack of the worker threads [bytes]. The pipeline itself runs on one of them, and readers recurse over the depth of the
/// scene; the default of 2 MiB is a quarter of what the main thread would have had.
const STACK_SIZE: usize = 16 << 20;

/// A bake as it is to be done.
pub struct Order {
    pub scene: PathBuf,
    /// Where results go.
    pub folder: PathBuf,
    pub settings: Settings,
    /// The config file that was read.
    pub file: Option<PathBuf>,
    /// It ends what shards have begun.
    pub merges: bool,
}

/// `lumel bake`.
pub fn bake(args: &BakeArgs, console: &Console) -> std::result::Result<(), Failure> {
    match &args.plan {
        Some(file) => plan::bake(args, file, console),
        None => run(args, args.output.as_deref(), !args.cache.no_cache, console, pipeline::bake),
    }
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
    let scene = args.scene().path().to_path_buf();
    let Resolved { mut settings, file } = config::resolve(args)?;
    let folder = destination::folder(&scene, output);
    match remembers {
        true => destination::set_cache(&mut settings, &folder),
        false => settings.cache = None,
    }
    carry_out(Order { scene, folder, settings, file, merges: false }, console, job)
}

/// Does `order` by `job`, and says what came of it.
///
/// # Errors
/// Those of the job; `Invalid` where it would replace an input.
pub fn carry_out(
    order: Order,
    console: &Console,
    job: impl Fn(&Path, &Path, &Settings, &dyn Progress) -> Result<Report> + Sync,
) -> std::result::Result<(), Failure> {
    let start = Instant::now();
    let Order { scene, folder, settings, file, merges } = order;
    let inputs: Vec<&Path> =
        [Some(scene.as_path()), file.as_deref(), settings.environment.as_deref()].into_iter().flatten().collect();
    destination::refuse_replacing(&scene, &inputs, &folder)?;

    // A shard writes nothing there.
    let written = settings.shard.is_none().then(|| folder.clone());
    interrupt::install(console, console.cancel_flag(), written);
    // A stage that fails isn't said to be done: the error takes its place.
    let report = workers(&settings)?.install(|| job(&scene, &folder, &settings, console))?;
    console.finish();
    console.warnings(&report.warnings);
    // What blocks see is put together from parts by whoever wants it, and light on backs is found on the way.
    let is_shared = |kind: &str| !["links", "backs", "places"].contains(&kind);
    let work = report.reused.iter().filter(|(kind, _)| is_shared(kind)).map(|(_, tally)| tally);
    let (found, made) = work.fold((0, 0), |(f, m), tally| (f + tally.reused, m + tally.anew));
    let mut summary = report.summary();
    if settings.shard.is_some() {
        let place = settings.cache.as_deref().unwrap_or(&folder);
        summary = vec![format!("did {made} parts of the work, found {found} that were done")];
        console.done(place, &summary, start.elapsed().as_secs_f64());
        return Ok(());
    }
    if merges {
        summary.push(match made {
            0 => "shards had done all of the work".to_string(),
            _ => format!("did {made} of {} parts of the work itself: shards had left them", found + made),
        });
    }
    console.done(&folder, &summary, start.elapsed().as_secs_f64());
    match report.verified.is_some_and(|verified| !verified.holds) {
        true => Err(Failure::Differs),
        false => Ok(()),
    }
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
