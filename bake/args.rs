//! What can be typed: the command line as clap reads it, before it means anything.
//!
//! Every option that stands for a setting is an `Option`, so that an absent flag leaves the config file's value alone; the
//! groups turn into TOML tables with the keys of `lumel.toml`, and [`super::config`] lays them over it. Values are kept as
//! text where the library has an enum: serde reads both the file and the flag, so there is one list of names to trust.

mod options;
mod values;

pub use options::*;
use values::{parse_bytes, parse_weight};

use clap::builder::PossibleValuesParser;
use clap::{Parser, Subcommand, ValueEnum, ValueHint};
use lumel::pipeline::Weight;
use serde::Serialize;
use std::path::PathBuf;

/// Bakes lightmaps: reads a USD or glTF scene, gives it lightmap UVs, solves the light by radiosity, and writes EXR pages,
/// GLBs and a USD layer.
#[derive(Debug, Parser)]
#[command(name = "lumel", version, propagate_version = true, max_term_width = 120)]
#[command(
    after_help = "Exit codes: 0 done, 1 failed, 2 usage, 3 done but --verify found a difference, 75 parts of other shards are missing, 130 interrupted.\n\
    LUMEL_LOG (or RUST_LOG) = error|warn|info|debug|trace writes a log to stderr."
)]
pub struct Args {
    #[command(subcommand)]
    pub command: Command,
    #[command(flatten)]
    pub console: ConsoleArgs,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Bake the light of a scene into lightmaps
    ///
    /// Writes lightmaps/<stem>_<page>.exr, <stem>.glb (lightmap UVs added, materials untouched), <stem>.vertex.glb (baked
    /// vertex colours), for a USD scene <stem>.lumel.usda (an override layer) and, where meshes were cut for the light,
    /// <stem>.vertex.usda (a layer of the pieces), and report.json. The input is never touched.
    Bake(Box<BakeArgs>),
    /// Find the light of a bake anew for other lamps, without tracing between surfaces
    ///
    /// What the bake remembers of what surfaces see of one another serves any light: lamps that are brighter, darker, off, of another
    /// colour, moved or added, another sun or sky, other emission and albedo. Direct light is traced of lamps alone that are new or
    /// elsewhere. A settings file says what differs from the bake, in `[[lamps]]`, `[[materials]]`, sun and sky.
    Relight(Box<RelightArgs>),
    /// Weigh the light groups of a bake against each other
    ///
    /// The pages become the sum of the layers that --layers light-groups left, each multiplied by its weight; nothing is traced
    /// between surfaces.
    Mix(Box<MixArgs>),
    /// Lay a bake out for several processes or machines
    ///
    /// Writes plan.json, which `lumel bake --plan` and `lumel merge` read, and template.yaml, the same as a job of Open Job Description
    /// (2023-09), which render farms take. Everything is checked now that a bake would check before its work begins.
    Plan(Box<PlanArgs>),
    /// End a bake that shards have worked on: `lumel bake --plan` without a shard
    ///
    /// What shards have left undone is done here, and said.
    Merge(MergeArgs),
    /// Make lightmap UVs only
    Unwrap(Box<UnwrapArgs>),
    /// Show what a bake would see: surfaces with roles, areas [m^2] and densities, lights with units, texels, warnings
    Inspect(Box<InspectArgs>),
    /// Write the matrix of form factors (view factors) of a small scene as NPZ, and print those between its surfaces
    ///
    /// For heat transfer as much as for light; the scene needs no light. numpy.load reads the file: form_factors (n, n), error
    /// (n, n), area [m^2], centre [m], normal, surface, back, closure (row sums), landed, scale (what a bake multiplies rows by), and
    /// surface_form_factors (m, m) with surface_names. Each form factor has the standard error that --quality asks for,
    /// relative to it or to the mean 1 / n: draft 5 %, medium 2 %, high 0.5 %, production 0.2 %. A result is never put in place
    /// of an input, nor, without --overwrite, of anything but the form factors of the same scene.
    FormFactors(Box<FormFactorArgs>),
    /// Take a picture of a scene through a camera, by rays
    ///
    /// Writes the picture [nit] as OpenEXR and, tone-mapped, as a PNG of the same name beside it: as it grows, and at the end. Of a bake's
    /// GLB it shows the lightmaps on matte surfaces, with glass and mirrors left out, unless a --method is given; the even sky of the bake, which
    /// the GLB's extras hold, is put back unless --sky or --environment give another.
    Render(Box<RenderArgs>),
    /// Compare two baked EXR pages, and draw where they differ
    Compare(CompareArgs),
    /// List, check or prune the results that bakes keep for later ones
    Cache(CacheArgs),
    /// Print a completion script for a shell
    Completions(CompletionArgs),
}

/// How the run talks, for every command.
#[derive(Debug, Default, clap::Args)]
#[command(next_help_heading = "Console")]
pub struct ConsoleArgs {
    /// Write nothing to stderr but errors
    #[arg(long, global = true)]
    pub quiet: bool,
    /// Form of progress, warnings and errors on stderr; json: one object a line; openjd: lines of text, with openjd_progress,
    /// openjd_status and openjd_fail for Open Job Description [default: text]
    #[arg(long, global = true, value_enum, value_name = "FORMAT", hide_possible_values = false)]
    pub log_format: Option<LogFormat>,
}

/// Form of what goes to stderr.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum LogFormat {
    Text,
    Json,
    /// As render farms read it that run jobs of Open Job Description
    Openjd,
}

/// `lumel bake`.
#[derive(Debug, clap::Args)]
#[command(mut_arg("scene", |arg| arg.required(false).required_unless_present("plan")))]
pub struct BakeArgs {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Do what `lumel plan` laid out, by its settings; SCENE, --output, --cache, --checkpoint, --threads and --overwrite may say where and
    /// how on this machine
    #[arg(long, value_name = "PLAN.json", value_hint = ValueHint::FilePath, help_heading = "Cache")]
    pub plan: Option<PathBuf>,
    /// Folder to write to; made where missing [default: ./<stem>_baked]
    #[arg(short, long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    pub only: OnlyArgs,
    #[command(flatten)]
    pub texels: TexelArgs,
    #[command(flatten)]
    pub adaptive: AdaptiveArgs,
    #[command(flatten)]
    pub uvs: UvArgs,
    #[command(flatten)]
    pub light: LightArgs,
    #[command(flatten)]
    pub solver: SolverArgs,
    #[command(flatten)]
    pub effort: EffortArgs,
    #[command(flatten)]
    pub results: ResultArgs,
    #[command(flatten)]
    pub vertices: VertexArgs,
    #[command(flatten)]
    pub running: RunningArgs,
    #[command(flatten)]
    pub cache: RememberArgs,
    #[command(flatten)]
    pub verify: VerifyArgs,
}

/// `lumel plan`.
#[derive(Debug, clap::Args)]
#[command(mut_arg("output", |arg| arg.value_name("JOB").help("Folder for plan.json and template.yaml; made where missing [default: ./<stem>_farm]")))]
#[command(mut_arg("cache", |arg| arg.help("Folder that shards share [default: cache in the plan's folder]")))]
#[command(mut_args(|arg| if ["plan", "shard", "no_cache", "only", "verify"].contains(&arg.get_id().as_str()) { arg.hide(true) } else { arg }))]
pub struct PlanArgs {
    /// How many processes are to share the work [1..4096]
    #[arg(long, value_name = "N", help_heading = "Cache")]
    pub shards: usize,
    #[command(flatten)]
    pub bake: BakeArgs,
}

/// `lumel merge`.
#[derive(Debug, clap::Args)]
pub struct MergeArgs {
    /// The plan
    #[arg(value_name = "PLAN.json", value_hint = ValueHint::FilePath)]
    pub plan: PathBuf,
    /// The scene, where it isn't where the plan has it
    #[arg(value_name = "SCENE", value_hint = ValueHint::FilePath)]
    pub scene: Option<PathBuf>,
    /// Folder to write to; made where missing [default: baked beside the plan]
    #[arg(short, long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub output: Option<PathBuf>,
    /// The cache that shards shared, where it isn't where the plan has it
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub cache: Option<PathBuf>,
    #[command(flatten)]
    pub running: RunningArgs,
}

/// `lumel relight`.
#[derive(Debug, clap::Args)]
pub struct RelightArgs {
    /// Output folder of the bake, or its report.json or GLB
    #[arg(value_name = "BAKED", value_hint = ValueHint::AnyPath)]
    pub baked: PathBuf,
    /// Settings file that says what differs from the bake
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub config: Option<PathBuf>,
    /// Folder to write to; made where missing [default: that of the bake]
    #[arg(short, long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub output: Option<PathBuf>,
    /// The scene file, where it isn't where it was
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub scene: Option<PathBuf>,
    /// Bake where nothing that fits is remembered
    #[arg(long)]
    pub or_bake: bool,
    #[command(flatten)]
    pub light: LightArgs,
    #[command(flatten)]
    pub results: ResultArgs,
    #[command(flatten)]
    pub running: RunningArgs,
    #[command(flatten)]
    pub cache: RecallArgs,
    #[command(flatten)]
    pub verify: VerifyArgs,
}

/// `lumel mix`.
#[derive(Debug, clap::Args)]
pub struct MixArgs {
    /// Output folder of the bake, or its report.json or GLB
    #[arg(value_name = "BAKED", value_hint = ValueHint::AnyPath)]
    pub baked: PathBuf,
    /// What the light of a group is multiplied by, may be repeated; those that aren't named count 1, and what has no group is
    /// `ungrouped` [0 or more]
    #[arg(long, value_name = "GROUP=W|R,G,B", value_parser = parse_weight)]
    pub weight: Vec<Weight>,
    /// Folder to write to; made where missing
    #[arg(short, long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub output: PathBuf,
    /// The scene file, where it isn't where it was
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub scene: Option<PathBuf>,
    #[command(flatten)]
    pub running: RunningArgs,
    #[command(flatten)]
    pub cache: RecallArgs,
}

/// `lumel unwrap`.
#[derive(Debug, clap::Args)]
pub struct UnwrapArgs {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Folder to write to; made where missing [default: ./<stem>_baked]
    #[arg(short, long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    pub texels: TexelArgs,
    #[command(flatten)]
    pub adaptive: AdaptiveArgs,
    #[command(flatten)]
    pub uvs: UvArgs,
    #[command(flatten)]
    pub running: RunningArgs,
}

/// `lumel inspect`.
#[derive(Debug, clap::Args)]
pub struct InspectArgs {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Print JSON in place of tables
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub texels: TexelArgs,
    #[command(flatten)]
    pub light: LightArgs,
}

/// `lumel form-factors`.
#[derive(Debug, clap::Args)]
pub struct FormFactorArgs {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// File to write to [default: ./<stem>_form_factors.npz]
    #[arg(short, long, value_name = "F.npz", value_hint = ValueHint::FilePath)]
    pub output: Option<PathBuf>,
    /// Print JSON in place of tables
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub factors: FactorArgs,
    #[command(flatten)]
    pub texels: TexelArgs,
    #[command(flatten)]
    pub uvs: UvArgs,
    #[command(flatten)]
    pub running: RunningArgs,
}

/// How form factors are found that are wanted for themselves.
#[derive(Debug, Default, clap::Args, Serialize)]
#[command(next_help_heading = "Form factors")]
#[serde(rename_all = "kebab-case")]
pub struct FactorArgs {
    /// How form factors are found; area: Monte Carlo area sampling; analytic: exact, but blind to what stands in between;
    /// hemicube: the scene drawn over each element; hemisphere: rays, the quickest and the noisiest [default: area]
    #[arg(long, value_name = "HOW", value_parser = PossibleValuesParser::new(["area", "analytic", "hemicube", "hemisphere"]))]
    pub form_factors: Option<String>,
    /// Cells along an edge of a hemicube's top [8..1024, even; default: 64]
    #[arg(long, value_name = "N")]
    pub hemicube: Option<u32>,
    /// Elements (clusters of texels), about: every surface has its own, and backs of double-sided ones come on top [1..20000;
    /// default: 128, 256, 512 or 1024 by --quality]
    #[arg(long, value_name = "N")]
    pub elements: Option<usize>,
    /// Seed of the random numbers; equal seeds give equal bytes [default: 0]
    #[arg(long, value_name = "N")]
    pub seed: Option<u32>,
}

/// `lumel render`.
#[derive(Debug, clap::Args)]
pub struct RenderArgs {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Picture to write, and a .png beside it; its folder is made where missing [default: ./<stem>.exr]
    #[arg(short, long, value_name = "F.exr", value_hint = ValueHint::FilePath)]
    pub output: Option<PathBuf>,
    /// Show a bake (its GLB) by a final gather: from every point of the picture rays read the lightmaps where they land, so that
    /// detail finer than a texel comes back [default: the lightmaps as they are]
    #[arg(long, conflicts_with = "method")]
    pub final_gather: bool,
    #[command(flatten)]
    pub view: ViewArgs,
    #[command(flatten)]
    pub walk: WalkArgs,
    #[command(flatten)]
    pub light: LightArgs,
    #[command(flatten)]
    pub running: RunningArgs,
}

/// `lumel compare`.
#[derive(Debug, clap::Args)]
pub struct CompareArgs {
    /// Page to judge
    #[arg(value_name = "A.exr", value_hint = ValueHint::FilePath)]
    pub test: PathBuf,
    /// Page to trust, of the same size; errors are relative to it
    #[arg(value_name = "B.exr", value_hint = ValueHint::FilePath)]
    pub reference: PathBuf,
    /// Error image to write: blue where A is darker, red where brighter, white where equal, black where neither has a
    /// surface, magenta where only one has
    #[arg(short, long, value_name = "error.png", value_hint = ValueHint::FilePath)]
    pub output: Option<PathBuf>,
    /// Relative error that is drawn in full blue or red, more than 0 [%]
    #[arg(long, value_name = "PERCENT", default_value_t = 20.0)]
    pub range: f32,
    /// Print JSON in place of a table
    #[arg(long)]
    pub json: bool,
}

/// `lumel cache`.
#[derive(Debug, clap::Args)]
pub struct CacheArgs {
    #[command(subcommand)]
    pub command: CacheCommand,
}

/// What to do with a cache.
#[derive(Debug, Subcommand)]
pub enum CacheCommand {
    /// List its entries, and how much room each kind takes
    List {
        #[command(flatten)]
        place: CachePlace,
        /// Print JSON in place of tables
        #[arg(long)]
        json: bool,
    },
    /// Check every entry; exits with 1 where one is damaged, and names it
    Verify {
        #[command(flatten)]
        place: CachePlace,
        /// Take damaged entries away
        #[arg(long)]
        remove: bool,
    },
    /// Remove what was used least recently
    Prune {
        #[command(flatten)]
        place: CachePlace,
        /// How much may stay: 2G, 512M, 0 [bytes]
        #[arg(long, value_name = "SIZE", value_parser = parse_bytes)]
        max_size: u64,
    },
}

/// Where a cache is.
#[derive(Debug, clap::Args)]
#[group(required = true, multiple = false)]
pub struct CachePlace {
    /// Output folder of a bake: its cache is .lumel within it
    #[arg(value_name = "OUTPUT", value_hint = ValueHint::DirPath)]
    pub output: Option<PathBuf>,
    /// The cache's own folder
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub cache: Option<PathBuf>,
}

/// `lumel completions`.
#[derive(Debug, clap::Args)]
pub struct CompletionArgs {
    /// The shell
    #[arg(value_name = "SHELL")]
    pub shell: clap_complete::Shell,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        use clap::CommandFactory;
        Args::command().debug_assert();
    }
}
