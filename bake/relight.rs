//! `lumel relight` and `lumel mix`: other light for a bake that stands.

use super::args::{MixArgs, RelightArgs};
use super::bake::{Order, carry_out};
use super::config::{self, Resolved};
use super::console::Console;
use super::destination;
use super::earlier::Earlier;
use super::failure::Failure;
use lumel::pipeline;
use lumel::progress::Progress;
use lumel::settings::{Relight, Settings};
use std::path::Path;

/// `lumel relight`.
///
/// # Errors
/// `Usage` where the settings are wrong; else the library's.
pub fn relight(args: &RelightArgs, console: &Console) -> Result<(), Failure> {
    let earlier = Earlier::read(&args.baked, args.scene.as_deref())?;
    let baked = earlier.settings_of_bake()?;
    let base = config::settings(baked.clone())?;
    let Resolved { mut settings, file } = config::resolve_over(baked, args.config.as_deref(), args.table()?)?;
    let what = if earlier.has_changed { "the scene has changed since it was baked; bake anew" } else { "bake first" };
    let advice = format!("{what} (or relight with --or-bake): {}", earlier.command()?);
    settings.relight = Some(Relight { baked: Box::new(base), advice, or_bake: args.or_bake });
    destination::set_cache(&mut settings, &earlier.folder);
    let folder = args.output.as_deref().unwrap_or(&earlier.folder);
    settings.overwrite |= is_same(folder, &earlier.folder);
    let order = Order { scene: earlier.scene, folder: folder.to_path_buf(), settings, file, merges: false };
    carry_out(order, console, pipeline::bake)
}

/// `lumel mix`.
///
/// # Errors
/// `Usage` where the settings are wrong; else the library's.
pub fn mix(args: &MixArgs, console: &Console) -> Result<(), Failure> {
    let earlier = Earlier::read(&args.baked, args.scene.as_deref())?;
    let Resolved { mut settings, .. } = config::resolve_over(earlier.settings()?, None, args.table()?)?;
    let cache = settings.cache.take().unwrap_or_else(|| destination::cache(&earlier.folder));
    settings.cache = cache.is_dir().then_some(cache);
    let job = |scene: &Path, folder: &Path, settings: &Settings, progress: &dyn Progress| {
        pipeline::mix(scene, &earlier.folder, folder, settings, &args.weight, progress)
    };
    let order = Order { scene: earlier.scene, folder: args.output.clone(), settings, file: None, merges: false };
    carry_out(order, console, job)
}

/// True of one folder by two names.
fn is_same(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}
