//! Groups of options, each with the keys of `lumel.toml` unless it says otherwise.

use super::values::{parse_camera, parse_size, parse_sky, parse_sun};
use clap::ValueHint;
use clap::builder::PossibleValuesParser;
use lumel::render::CameraChoice;
use lumel::settings::SkySetting;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// The scene, and the settings that hold for all of a run.
#[derive(Debug, Default, clap::Args, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct SceneArgs {
    /// Scene file: .gltf .glb .usd .usda .usdc .usdz
    #[arg(value_name = "SCENE", value_hint = ValueHint::FilePath, required = true)]
    #[serde(skip)]
    pub scene: Option<PathBuf>,
    /// Settings file with the long options as keys [default: lumel.toml beside the scene, where there is one]
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    #[serde(skip)]
    pub config: Option<PathBuf>,
    /// Preset for every stage. Without --density or --resolution the scene gets about 2^16, 2^18, 2^20 or 2^22 texels
    /// [default: medium]
    #[arg(long, short, value_name = "PRESET", value_parser = PossibleValuesParser::new(["draft", "medium", "high", "production"]))]
    pub quality: Option<String>,
    /// Read moving parts at this moment: seconds in glTF, a time code in USD [default: at rest]
    #[arg(long, value_name = "T", allow_negative_numbers = true)]
    pub time: Option<f64>,
    /// glTF: the animation that --time is of, by name or number from 0 [default: the first one]
    #[arg(long, value_name = "NAME")]
    pub animation: Option<String>,
    /// Read this variant in place of the default, may be repeated: a name in glTF (KHR_materials_variants), PRIM:SET=NAME in
    /// USD
    #[arg(long, value_name = "VARIANT")]
    pub variant: Option<Vec<String>>,
    /// Refine USD's subdivision surfaces N times; 0: bake their control cages, as most engines show them [0..8; default: 0]
    #[arg(long, value_name = "N")]
    pub subdivide: Option<u32>,
    /// USD's purposes to draw beside what has none, separated by commas: default, render, proxy, guide [default: render]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = PossibleValuesParser::new(["default", "render", "proxy", "guide"]))]
    pub purpose: Option<Vec<String>>,
    #[command(flatten)]
    #[serde(flatten)]
    pub limits: LimitArgs,
}

impl SceneArgs {
    /// The scene; empty where a plan names it.
    pub fn path(&self) -> &Path {
        self.scene.as_deref().unwrap_or(Path::new(""))
    }
}

/// What a scene may pull in and take: for scenes from anywhere.
#[derive(Debug, Default, clap::Args, Serialize)]
#[command(next_help_heading = "Limits")]
#[serde(rename_all = "kebab-case")]
pub struct LimitArgs {
    /// Refuse a scene that reads anything outside of this folder, symbolic links resolved: buffers, pictures, layers, assets,
    /// profiles, and what a lumel.toml beside it names [default: glTF keeps to its own folder, USD reads from anywhere]
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub confine: Option<PathBuf>,
    /// Fail where input is missing or can't be read, in place of a warning [default: false]
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true", hide_possible_values = true)]
    pub strict: Option<bool>,
    /// Largest picture, width times height [texels; 1..268435456; default: 268435456]
    #[arg(long, value_name = "N")]
    pub max_texture: Option<u64>,
    /// Refuse more texels than this [default: no limit]
    #[arg(long, value_name = "N")]
    pub max_texels: Option<u64>,
    /// Refuse what would take more memory than this, by an estimate: 4G, 512M [bytes; default: no limit; of pictures the machine's memory]
    #[arg(long, value_name = "BYTES")]
    pub max_memory: Option<String>,
}

/// How many texels, on which pages.
#[derive(Debug, Default, clap::Args, Serialize)]
#[command(next_help_heading = "Texels")]
#[serde(rename_all = "kebab-case")]
pub struct TexelArgs {
    /// Everything on one page of N x N texels, density chosen to fill it [texels; 16..16384]
    #[arg(long, value_name = "N", conflicts_with_all = ["density", "page_size"])]
    pub resolution: Option<u32>,
    /// Size of the texels [texels per metre; 0.0001..100000; default: by --quality]
    #[arg(long, value_name = "T")]
    pub density: Option<f32>,
    /// Largest page, N x N [texels; 16..16384; default: 2048]
    #[arg(long, value_name = "N")]
    pub page_size: Option<u32>,
    /// Most pages; the density falls, with a warning, where more would be needed [1..1024; default: 64]
    #[arg(long, value_name = "K")]
    pub max_pages: Option<u32>,
    /// Sizes of pages; pot: powers of two; free: multiples of 4 (of --align where that is more), cut to what they hold
    /// [default: pot]
    #[arg(long, value_name = "SIZES", value_parser = PossibleValuesParser::new(["pot", "free"]))]
    pub pages: Option<String>,
}

/// Where texels go.
#[derive(Debug, Default, clap::Args, Serialize)]
#[command(next_help_heading = "Texels")]
#[serde(rename_all = "kebab-case")]
pub struct AdaptiveArgs {
    /// Give charts more texels where a quick bake finds that light varies, and the others fewer, as many in all; 1: so that the
    /// error is least, less: part of the way [0..1; default: 0, with the flag alone 1]
    #[arg(long, value_name = "STRENGTH", num_args = 0..=1, require_equals = true, default_missing_value = "1")]
    pub adaptive_density: Option<f32>,
}

/// Baked vertex colours.
#[derive(Debug, Default, clap::Args, Serialize)]
#[command(next_help_heading = "Vertex colours")]
#[serde(rename_all = "kebab-case")]
pub struct VertexArgs {
    /// How meshes follow the light; adaptive: triangles are cut where values between vertices miss it; discontinuity: along the edges
    /// of shadows and contacts first [default: given]
    #[arg(long, value_name = "HOW", value_parser = PossibleValuesParser::new(["given", "adaptive", "discontinuity"]))]
    pub mesh: Option<String>,
    /// How far values between vertices may miss the light of the lightmap, relative to it, or to 5 % of its mean where that is more
    /// [0.1%..100%; default: 5%]
    #[arg(long, value_name = "PERCENT")]
    pub vertex_error: Option<String>,
    /// Triangles with baked vertex colours, at most [default: as many as the error takes]
    #[arg(long, value_name = "N")]
    pub max_triangles: Option<u64>,
    /// Form of COLOR_0 in the vertex GLB, linear light over the file's vertexScale; u8 and u16: integers that stand for 0..1, a third
    /// and two thirds of the size; _IRRADIANCE beside it is always float [default: float]
    #[arg(long, value_name = "FORM", value_parser = PossibleValuesParser::new(["u8", "u16", "float"]))]
    pub vertex_colors: Option<String>,
}

/// Lightmap UVs.
#[derive(Debug, Default, clap::Args, Serialize)]
#[command(next_help_heading = "Lightmap UVs")]
#[serde(rename_all = "kebab-case")]
pub struct UvArgs {
    /// Empty texels between charts [texels; 1..64; default: 2]
    #[arg(long, value_name = "N")]
    pub padding: Option<u32>,
    /// Mip levels, the full size among them: bilinear filtering of each reads no other chart, by a padding of at least 2^N texels,
    /// and KTX2 pages hold as many [1..6; default: 1 with the padding as it is]
    #[arg(long, value_name = "N")]
    pub mips: Option<u32>,
    /// No block of N x N texels holds two charts, for textures compressed by block [texels; 1, 2, 4 .. 64; default: 1]
    #[arg(long, value_name = "N")]
    pub align: Option<u32>,
    /// Least width and height of a chart; smaller ones are stretched [texels; 1..64; default: 1]
    #[arg(long, value_name = "N")]
    pub min_chart: Option<u32>,
    /// Lay out all objects anew; by default, what is as it was in the bake before stays where it was on the pages, and what is new
    /// gets the room between and pages of its own, until a fifth of the texels have come or gone [default: false]
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true", hide_possible_values = true)]
    pub fresh_places: Option<bool>,
    /// auto: authored lightmap UVs where they are sound, else new ones; keep: authored ones or an error; repack: authored
    /// charts, packed anew at the bake's density; new: new ones [default: auto]
    #[arg(long, value_name = "MODE", value_parser = PossibleValuesParser::new(["auto", "keep", "repack", "new"]))]
    pub uv: Option<String>,
    /// What makes new UVs: xatlas or uvunwrap [default: xatlas]
    #[arg(long, value_name = "NAME", value_parser = PossibleValuesParser::new(["xatlas", "uvunwrap"]))]
    pub unwrapper: Option<String>,
    /// Name of the UV set [default: TEXCOORD_1, st1]
    #[arg(long, value_name = "NAME")]
    pub uv_name: Option<String>,
}

/// Light for a scene that has none, or in place of its own sky.
#[derive(Debug, Default, clap::Args, Serialize)]
#[command(next_help_heading = "Light")]
#[serde(rename_all = "kebab-case")]
pub struct LightArgs {
    /// Sky in place of the scene's: a constant radiance, linear Rec.709 [nit; 0 or more], or clear[,TURBIDITY] around the --sun
    /// (Preetham 1999) [turbidity 1.7..10; default 3]
    #[arg(long, value_name = "R,G,B|clear", value_parser = parse_sky, conflicts_with = "environment")]
    pub sky: Option<SkySetting>,
    /// A sun: degrees above the horizon, degrees clockwise from north (-Z), lux at normal incidence; a disc of 0.53 degrees
    #[arg(long, value_name = "ELEVATION,AZIMUTH,LUX", value_parser = parse_sun, allow_hyphen_values = true)]
    pub sun: Option<[f32; 3]>,
    /// Latlong picture (.exr .hdr .png .jpg) as the sky, in place of the scene's [nit]
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub environment: Option<PathBuf>,
    /// Lights that are baked in, which an engine would add again: mark them in the output, remove them, or keep them as
    /// they are [default: mark]
    #[arg(long, value_name = "WHAT", value_parser = PossibleValuesParser::new(["mark", "remove", "keep"]))]
    pub lights: Option<String>,
    /// What of the light of lights is baked that say nothing about it themselves: all of it; indirect light alone, the engine adds
    /// their direct light; or nothing [default: baked]
    #[arg(long, value_name = "MODE", value_parser = PossibleValuesParser::new(["baked", "indirect", "dynamic"]))]
    pub bake_lights: Option<String>,
}

/// How light between surfaces is solved.
#[derive(Debug, Default, clap::Args, Serialize)]
#[command(next_help_heading = "Solver")]
#[serde(rename_all = "kebab-case")]
pub struct SolverArgs {
    /// How the radiosity system is solved; auto chooses by size, and the report says which [default: auto]
    #[arg(long, value_name = "WHICH", value_parser = PossibleValuesParser::new(["auto", "full-matrix", "jacobi", "gauss-seidel", "progressive", "hierarchical"]))]
    pub solver: Option<String>,
    /// How form factors are found; area: Monte Carlo area sampling; analytic: exact, but blind to what stands in between;
    /// hemicube: the scene drawn over each element; hemisphere: rays, the quickest and the noisiest [default: area]
    #[arg(long, value_name = "HOW", value_parser = PossibleValuesParser::new(["area", "analytic", "hemicube", "hemisphere"]))]
    pub form_factors: Option<String>,
    /// Cells along an edge of a hemicube's top [8..1024, even; default: 64]
    #[arg(long, value_name = "N")]
    pub hemicube: Option<u32>,
    /// Elements (clusters of texels) that exchange light; as many as texels: each texel is one [1..4194304; default: by
    /// --quality]
    #[arg(long, value_name = "N")]
    pub elements: Option<usize>,
    /// Power that a link between clusters may misplace, relative to all power (hierarchical) [1e-12..0.01; default: by
    /// --quality]
    #[arg(long, value_name = "SHARE")]
    pub link_error: Option<f64>,
    /// Stop after so many shots (progressive) or sweeps (others) [1 or more; default: once converged]
    #[arg(long, value_name = "N")]
    pub iterations: Option<u64>,
    /// Shoot ahead what the shooter is about to receive (progressive) [default: false]
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true", hide_possible_values = true)]
    pub overshoot: Option<bool>,
    /// Add the ambient term for light that is not shot yet (progressive) [default: false]
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true", hide_possible_values = true)]
    pub ambient: Option<bool>,
    /// How texels get their light; blocks: together, as many as the light varies slowly over, to the --error that is asked for;
    /// final: each over its own hemisphere, slower, the reference for the former; none: as their element has it, which is coarse
    /// unless --elements is as fine as the texels [default: blocks, or final where an option asks for elements or --samples]
    #[arg(long, value_name = "HOW", value_parser = PossibleValuesParser::new(["auto", "blocks", "final", "none"]))]
    pub gather: Option<String>,
}

/// How hard to work.
#[derive(Debug, Default, clap::Args, Serialize)]
#[command(next_help_heading = "Effort")]
#[serde(rename_all = "kebab-case")]
pub struct EffortArgs {
    /// radiosity: light exchanged between surfaces, see --gather; path: paths from each texel, slower, the reference for
    /// the other; ray: light straight from what shines alone; bidirectional: paths from texels and from lights, joined; metropolis:
    /// chains of such paths, for light that is hard to find; photon: photons from what shines, for light that mirrors and glass
    /// gather. Methods other than radiosity see mirrors, metals, glass and media [default: radiosity]
    #[arg(long, value_name = "METHOD", value_parser = PossibleValuesParser::new(["radiosity", "path", "ray", "bidirectional", "metropolis", "photon"]))]
    pub method: Option<String>,
    /// What of materials methods other than radiosity see: all, or the diffuse stand-ins that radiosity bakes [default: full]
    #[arg(long, value_name = "WHAT", value_parser = PossibleValuesParser::new(["full", "diffuse"]))]
    pub surfaces: Option<String>,
    /// Add light that comes from lights over mirrors and glass alone to the direct light of radiosity, by photons; what
    /// comes to mirrors and glass off other surfaces they send on diffusely, under a sky not at all [default: false]
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true", hide_possible_values = true)]
    pub caustics: Option<bool>,
    /// Stop at this estimated error: noise and bias together, root mean square over the mean light, against the texels' area
    /// averages, without the worst 1 % of texels [0.05%..50%; default: 5%, 2%, 1% or 0.5% by --quality]
    #[arg(long, value_name = "PERCENT")]
    pub error: Option<String>,
    /// Time for the whole bake: the best result within it, or within --error sooner; results then depend on the machine [s;
    /// 0.1..1000000]
    #[arg(long, value_name = "SECONDS")]
    pub time_budget: Option<f64>,
    /// Interreflections counted; 0: direct light only [0..100; default: until the solution has converged]
    #[arg(long, value_name = "N")]
    pub max_bounces: Option<u32>,
    /// Final gather rays, or paths, for each texel [1..65536; default: by --quality]
    #[arg(long, value_name = "N")]
    pub samples: Option<u32>,
    /// Seed of the random numbers; equal seeds give equal bytes [default: 0]
    #[arg(long, value_name = "N")]
    pub seed: Option<u32>,
}

/// What is written.
#[derive(Debug, Default, clap::Args, Serialize)]
#[command(next_help_heading = "Results")]
#[serde(rename_all = "kebab-case")]
pub struct ResultArgs {
    /// Engine that the result goes into: chooses --quantity, --encoding and --gltf-lightmap-ext as it wants them, each of which can
    /// be given another, and writes <stem>.loading.txt, which says how to load this bake
    #[arg(long = "for", value_name = "ENGINE", value_parser = PossibleValuesParser::new(["bevy", "godot", "unity", "unreal", "three", "playcanvas", "babylon", "blender", "needle", "hubs"]))]
    #[serde(rename = "for")]
    pub engine: Option<String>,
    /// What a texel holds; outgoing: E / pi [nit], to be multiplied by the albedo and nothing else; irradiance: E [lx];
    /// radiosity: B [lm/m^2], emission included [default: outgoing]
    #[arg(long, value_name = "WHAT", value_parser = PossibleValuesParser::new(["outgoing", "irradiance", "radiosity"]))]
    pub quantity: Option<String>,
    /// The normal that E is about: the interpolated one where authored, or the triangle's [default: shading]
    #[arg(long, value_name = "WHICH", value_parser = PossibleValuesParser::new(["shading", "geometric"]))]
    pub normals: Option<String>,
    /// What takes noise out of light between surfaces, within each chart: builtin; oidn: Open Image Denoise 2, whose library must be
    /// there; off; auto: builtin, but paths stay as they are [default: auto]
    #[arg(long, value_name = "FILTER", value_parser = PossibleValuesParser::new(["auto", "builtin", "oidn", "off"]))]
    pub denoise: Option<String>,
    /// The library of Open Image Denoise, as LUMEL_OIDN names it [default: looked for by its usual names]
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub oidn_library: Option<PathBuf>,
    /// Where charts meet, light is made to agree: between all, those of one surface alone, or off [default: all]
    #[arg(long, value_name = "WHICH", value_parser = PossibleValuesParser::new(["all", "surface", "off"]))]
    pub seams: Option<String>,
    /// What the space between charts holds; all: light of the charts around, so that mip levels read no black; padding: nothing
    /// beyond the padding [default: all]
    #[arg(long, value_name = "WHAT", value_parser = PossibleValuesParser::new(["all", "padding"]))]
    pub gutter: Option<String>,
    /// Parts of the light as layers of the pages, separated by commas: direct, indirect, caustics (what
    /// --caustics adds), bounces (emitted, then reflected no
    /// time, once, twice, ... before it arrives), error (the estimated standard error), emission, light-groups (the light that
    /// each group of lights causes), shadow-masks (the visible share of each light that is not wholly baked, or else of all up to
    /// 16); and of what surrounds a texel ao (the open share of its hemisphere), bent-normal (the mean open direction),
    /// sky-visibility
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = PossibleValuesParser::new([
        "direct", "indirect", "caustics", "bounces", "error", "emission", "light-groups", "shadow-masks", "ao", "bent-normal", "sky-visibility",
    ]))]
    pub layers: Option<Vec<String>>,
    /// How far away things occlude in the layers ao and bent-normal [m; 0: however far; default: 1]
    #[arg(long, value_name = "METRES")]
    pub ao_distance: Option<f32>,
    /// Forms of the pages, separated by commas; rgbm, rgbm-srgb and rgbd are 8-bit PNGs with a multiplier in alpha, as PlayCanvas,
    /// Needle Engine and Babylon.js decode them [default: exr]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = PossibleValuesParser::new(["exr", "hdr", "rgbm", "rgbm-srgb", "rgbd", "ktx2-half", "ktx2-bc6h"]))]
    pub encoding: Option<Vec<String>>,
    /// Where light comes from, as layers of the pages, for materials with normal maps; sh: spherical harmonics to order 1,
    /// value(n) = sh0 + sh1x n.x + sh1y n.y + sh1z n.z by channel; dominant: one mean direction, as long as light agrees on it;
    /// n in world space, Y up [default: off]
    #[arg(long, value_name = "FORM", value_parser = PossibleValuesParser::new(["off", "sh", "dominant"]))]
    pub directional: Option<String>,
    /// Light probes over the scene, so far apart at most: spherical harmonics to order 2 of the light that passes through each, for
    /// objects without a lightmap, in probes.json and probes.exr; positions and boxes are given as [[probes]] in a lumel.toml
    /// [m; 0.001..1000000]
    #[arg(long, value_name = "SPACING")]
    pub probes: Option<f32>,
    /// 32-bit float pages in place of 16-bit half [default: false]
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true", hide_possible_values = true)]
    pub float: Option<bool>,
    /// Forms of the GLB, separated by commas [default: engine,vertex]
    #[arg(long, value_name = "FORMS", value_delimiter = ',', value_parser = PossibleValuesParser::new(["engine", "vertex"]))]
    pub gltf: Option<Vec<String>>,
    /// Name pages in the GLB by an extension as well: MOZ_lightmap on materials, MX_lightmap on nodes, NEEDLE_lightmaps at the root;
    /// adds the encoding that it can name [default: the extras alone]
    #[arg(long, value_name = "WHICH", value_parser = PossibleValuesParser::new(["moz", "mx", "needle"]))]
    pub gltf_lightmap_ext: Option<String>,
    /// Folder for numbered EXR files of the stages in between
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub dump_stages: Option<PathBuf>,
    /// Folder for pages of the solution as it grows, an EXR and a small PNG each
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub watch: Option<PathBuf>,
    /// Shots or sweeps from one of them to the next [1 or more; default: a sweep, or a 32nd of the elements in shots, of which
    /// an element may take several]
    #[arg(long, value_name = "N")]
    pub watch_every: Option<u64>,
}

/// Running it.
#[derive(Debug, Default, clap::Args, Serialize)]
#[command(next_help_heading = "Running")]
#[serde(rename_all = "kebab-case")]
pub struct RunningArgs {
    /// Worker threads; the result doesn't depend on it [1..1024; default: one for each core]
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// Replace another scene's bake in the output folder [default: false]
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true", hide_possible_values = true)]
    pub overwrite: Option<bool>,
}

/// What is baked.
#[derive(Debug, Default, clap::Args, Serialize)]
#[command(next_help_heading = "Selection")]
#[serde(rename_all = "kebab-case")]
pub struct OnlyArgs {
    /// Bake the objects of this path alone, may be repeated; the texels of all others stay as the bake in the output folder left them, and
    /// send on the light that they show. A path is as in [[objects]]: names joined by /, * for anything within a name, ** for any
    /// names, and what lies below it [default: all objects]
    #[arg(long, value_name = "PATTERN")]
    pub only: Option<Vec<String>>,
}

/// Whether what is remembered is trusted.
#[derive(Debug, Default, clap::Args, Serialize)]
#[command(next_help_heading = "Cache")]
#[serde(rename_all = "kebab-case")]
pub struct VerifyArgs {
    /// Where something remembered was used, bake all again in memory without it, and compare: more than noise explains is a warning,
    /// and exit code 3 [default: false]
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true", hide_possible_values = true)]
    pub verify: Option<bool>,
}

/// What is remembered.
#[derive(Debug, Default, clap::Args, Serialize)]
#[command(next_help_heading = "Cache")]
#[serde(rename_all = "kebab-case")]
pub struct RememberArgs {
    /// Folder of what bakes remember: the direct light of each lamp, and what blocks of texels see of one another. The next bake
    /// traces only what changed; one that was killed goes on where it was [default: .lumel in the output folder]
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub cache: Option<PathBuf>,
    /// Let go of what other bakes left there, the oldest first, once there is more than this: 4G, 512M [bytes; default: 4G in the output
    /// folder, no limit in --cache DIR]
    #[arg(long, value_name = "BYTES", conflicts_with = "no_cache")]
    pub cache_limit: Option<String>,
    /// Remember nothing, and read nothing that was remembered
    #[arg(long, conflicts_with = "cache")]
    #[serde(skip)]
    pub no_cache: bool,
    /// Work that takes longer is put into the cache part by part, from then on; 0: from the start [s; 0..1000000; default: 60]
    #[arg(long, value_name = "SECONDS")]
    pub checkpoint: Option<f64>,
    /// Do the part I of the work, of N processes that share a cache, and write nothing else: whoever is done first helps the others.
    /// `I/N alone`: on a machine that shares no folder, whose cache is brought together with the others'. `lumel merge` ends the bake
    #[arg(long, value_name = "I/N", conflicts_with = "no_cache")]
    pub shard: Option<String>,
}

/// Where is remembered what is needed.
#[derive(Debug, Default, clap::Args, Serialize)]
#[command(next_help_heading = "Cache")]
#[serde(rename_all = "kebab-case")]
pub struct RecallArgs {
    /// Folder of what the bake remembers [default: .lumel in its output folder]
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub cache: Option<PathBuf>,
}

/// Where a picture is taken from.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "View")]
pub struct ViewArgs {
    /// The scene's camera of this name, or a place to stand, a place to look at [m, Y up], and the vertical angle of view [degrees]
    /// [default: the scene's first camera]
    #[arg(long, value_name = "NAME|X,Y,Z,X,Y,Z,ANGLE", value_parser = parse_camera, allow_hyphen_values = true)]
    pub camera: Option<CameraChoice>,
    /// Width, or width x height [pixels; 1..16384; default: 960, height as the camera's shape has it]
    #[arg(long, value_name = "W[xH]", value_parser = parse_size)]
    pub size: Option<(u32, Option<u32>)>,
    /// How much brighter the PNG is than with its middle at a middle grey [stops]
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    pub exposure: f32,
}

/// How light is followed into a picture.
#[derive(Debug, Default, clap::Args, Serialize)]
#[command(next_help_heading = "Effort")]
#[serde(rename_all = "kebab-case")]
pub struct WalkArgs {
    /// path: paths from the camera; ray: light straight from what shines, over mirrors and through glass; bidirectional: paths
    /// from the camera and from lights, joined; metropolis: chains of such paths, for light that is hard to find; photon: photons
    /// from what shines, for light that mirrors and glass gather [default: path]
    #[arg(long, value_name = "METHOD", value_parser = PossibleValuesParser::new(["path", "ray", "bidirectional", "metropolis", "photon"]))]
    pub method: Option<String>,
    /// What of materials is seen: all, or the diffuse stand-ins that radiosity bakes [default: full]
    #[arg(long, value_name = "WHAT", value_parser = PossibleValuesParser::new(["full", "diffuse"]))]
    pub surfaces: Option<String>,
    /// Samples of each pixel [1..65536; default: 64, or as many as the time budget allows]
    #[arg(long, value_name = "N")]
    pub samples: Option<u32>,
    /// End with this time, reading and writing included; where it is too short for a sample of each pixel, squares of pixels are sampled; the picture then depends on the machine [s; 0.1..1000000]
    #[arg(long, value_name = "SECONDS")]
    pub time_budget: Option<f64>,
    /// Reflections counted; 0: direct light only [0..100; default: all]
    #[arg(long, value_name = "N")]
    pub max_bounces: Option<u32>,
    /// Seed of the random numbers; equal seeds give equal bytes [default: 0]
    #[arg(long, value_name = "N")]
    pub seed: Option<u32>,
}
