//! `lumel plan`, `lumel bake --plan` and `lumel merge`: a bake by several processes, on one machine or many.

use super::args::{BakeArgs, MergeArgs, PlanArgs};
use super::bake::{Order, carry_out, workers};
use super::config::{self, Resolved};
use super::console::Console;
use super::failure::Failure;
use super::print::{self, count};
use super::{destination, interrupt};
use lumel::Error;
use lumel::pipeline;
use lumel::plan::{PLAN_FILE, Plan, TEMPLATE_FILE};
use lumel::settings::Settings;
use std::path::{Path, PathBuf};

/// `lumel plan`.
///
/// # Errors
/// `Usage` where the settings are wrong; those of [`Plan::new`] and [`Plan::write`].
pub fn plan(args: &PlanArgs, console: &Console) -> Result<(), Failure> {
    let scene = args.bake.scene.path();
    let of_shards = [
        (args.bake.plan.is_some(), "plan", "is what comes out; leave it out"),
        (
            args.bake.cache.shard.is_some(),
            "shard",
            "is for those who do the work; say how many there are with --shards",
        ),
        (args.bake.cache.no_cache, "no-cache", "shards share what they find in a cache; leave it out"),
    ];
    if let Some((_, option, message)) = of_shards.iter().find(|(is_given, ..)| *is_given) {
        return Err(Failure::Usage(Error::invalid(format!("--{option}"), message)));
    }
    let Resolved { settings, file: _ } = config::resolve(&args.bake)?;
    Plan::check(&settings, args.shards).map_err(Failure::Usage)?;
    let asked = args.bake.output.clone();
    let folder = asked.unwrap_or_else(|| PathBuf::from(format!("{}_farm", destination::stem(scene))));
    interrupt::install(console, console.cancel_flag(), Some(folder.clone()));
    let (plan, warnings) =
        workers(&settings)?.install(|| Plan::new(scene, &folder, &settings, args.shards, console))?;
    plan.write()?;
    console.finish();
    console.warnings(&warnings);
    print::print(&text(&plan, &folder))
}

/// What is to be run.
fn text(plan: &Plan, folder: &Path) -> String {
    let n = plan.shards;
    let scene = if plan.scene.starts_with(&plan.folder) {
        String::new()
    } else {
        format!(" -p \"Scene={}\"", plan.scene.display())
    };
    format!(
        "{}: about {} texels in {n} shards\n  lumel bake --plan {PLAN_FILE} --shard 1/{n}  (to {n}/{n})\n  lumel merge {PLAN_FILE}\n\
         or, as Open Job Description\n  openjd run {TEMPLATE_FILE} --step Merge --run-dependencies{scene}\n",
        folder.display(),
        count(plan.estimate.texels),
    )
}

/// `lumel bake --plan`: a shard, or all of it.
///
/// # Errors
/// `Usage` where something is typed that the plan says; those of [`Plan::read`]; those of a bake.
pub fn bake(args: &BakeArgs, file: &Path, console: &Console) -> Result<(), Failure> {
    if args.cache.no_cache {
        let message = "the work of a plan is shared by a cache; leave it out";
        return Err(Failure::Usage(Error::invalid("--no-cache", message)));
    }
    let own = config::beside_plan(args)?;
    let plan = Plan::read(file, args.scene.scene.as_deref())?;
    if let Some(shard) = own.shard.filter(|shard| shard.count != plan.shards) {
        let message = format!("there are {} of them, and {} has {}", shard.count, file.display(), plan.shards);
        return Err(Failure::Usage(Error::invalid("--shard", message)));
    }
    carry_out(order(plan, own, args.output.as_deref()), console, pipeline::bake)
}

/// `lumel merge`.
///
/// # Errors
/// Those of [`Plan::read`], and of a bake.
pub fn merge(args: &MergeArgs, console: &Console) -> Result<(), Failure> {
    let own = Settings {
        cache: args.cache.clone(),
        threads: args.running.threads,
        overwrite: args.running.overwrite.unwrap_or_default(),
        ..Settings::default()
    };
    own.check().map_err(Failure::Usage)?;
    let plan = Plan::read(&args.plan, args.scene.as_deref())?;
    carry_out(Order { merges: true, ..order(plan, own, args.output.as_deref()) }, console, pipeline::bake)
}

/// The bake of `plan`, as this machine does it: `own` has what a plan doesn't say.
fn order(plan: Plan, own: Settings, output: Option<&Path>) -> Order {
    let folder = output.map_or_else(|| plan.output(), Path::to_path_buf);
    let settings = Settings {
        cache: own.cache.or(Some(plan.cache)),
        checkpoint: own.checkpoint,
        shard: own.shard,
        threads: own.threads,
        overwrite: own.overwrite,
        // What one machine remembers of earlier bakes, others don't.
        fresh_places: true,
        ..plan.settings
    };
    Order { scene: plan.scene, folder, settings, file: None, merges: false }
}
