//! `lumel inspect`.
use super::args::InspectArgs;
use super::config;
use super::console::Console;
use super::failure::Failure;

/// `lumel inspect`.
pub fn inspect(args: &InspectArgs, _console: &Console) -> Result<(), Failure> {
    let _settings = config::resolve(args)?.settings;
    let _loaded = lumel::load::load(&args.scene.scene)?;
    Ok(())
}
