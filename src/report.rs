//! What a bake did, for people and for `report.json`.

use crate::adaptive::AdaptiveReport;
use crate::digest;
use crate::energy::EnergyBalance;
use crate::error::{Error, Result, Warnings};
use crate::meshing::{MeshMode, VertexReport};
use crate::post::{Layer, denoise::DenoiseReport, seam::SeamReport};
use crate::probe::LightProbes;
use crate::progress::Progress;
use crate::scene::{BakeMode, Contribution, Environment};
use crate::settings::{Gather, Settings};
use crate::solve::{LinkReport, Step};
use crate::store::Key;
use crate::transport::Method as FormFactors;
use crate::unwrap::AuthoredUvs;
use crate::work::Tally;
use crate::write::encode::Encoding;
use crate::write::exr::{channel_names, exceeds_half};
use crate::write::{Baked, probes::FILES as PROBE_FILES};
use cpu_time::ProcessTime;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What a bake did; written as `report.json`.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Report {
    /// Version of Lumel.
    pub version: &'static str,
    /// Every file that was read: the scene first.
    pub inputs: Vec<Input>,
    pub settings: Settings,
    pub surfaces: Vec<SurfaceReport>,
    pub pages: Vec<PageReport>,
    /// What pages hold beside the whole.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub layers: Vec<LayerReport>,
    /// Lights, and skies, whose light adds up.
    pub lights: Vec<LightReport>,
    /// Forms that pages were written in, besides or in place of OpenEXR.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub encodings: Vec<EncodingReport>,
    /// Authored UVs that were refused or packed anew.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub authored_uvs: Vec<AuthoredUvs>,
    /// Texels per metre.
    pub density: f32,
    /// How texels went where light varies; absent where they didn't.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub adaptive: Option<AdaptiveReport>,
    /// Covered texels, those of hidden pages included.
    pub texels: usize,
    /// Texels that lie inside other geometry.
    pub buried_texels: usize,
    pub triangles: usize,
    pub stages: Vec<StageTime>,
    /// Rays and visibility segments that the light took, those of what is `reused` among them.
    pub rays: u64,
    /// Absent where paths were traced.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub solver: Option<SolverReport>,
    /// Noise of the gathered light over all texels, root mean square over mean irradiance.
    pub noise: f64,
    /// What was remembered by earlier bakes, and what was found anew, by kind; absent without a cache.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub reused: BTreeMap<String, Tally>,
    /// The settings of the bake that this is other light for; absent where this is a bake.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relit: Option<Box<Settings>>,
    /// What light groups were multiplied by; absent unless pages were mixed of them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mixed: Option<Vec<MixReport>>,
    /// What was baked and what was kept of an earlier bake; absent where all was baked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub only: Option<OnlyReport>,
    /// How far the bake is from one that remembers nothing; absent unless that was asked for and something remembered was used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub verified: Option<Verified>,
    /// What error is estimated to be left; absent where blocks did not gather.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<ErrorReport>,
    /// How noise was taken out; absent where it was not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub denoise: Option<DenoiseReport>,
    /// How far light jumps across seams.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seams: Option<SeamReport>,
    #[serde(skip_serializing_if = "EnergyBalance::is_empty")]
    pub energy: EnergyBalance,
    /// How well the light at vertices holds that of texels; absent without light.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vertices: Option<VertexReport>,
    /// Absent without light probes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub probes: Option<ProbeReport>,
    /// Most memory that the process held [bytes]; absent where the system doesn't tell.
    pub peak_memory_bytes: Option<u64>,
    /// What the output folder holds of this scene beside the report, relative to it. The next bake into it lets go what it doesn't
    /// write itself.
    pub files: Vec<String>,
    pub warnings: Warnings,
}

/// The error of a bake as it is estimated: root mean square over the mean light, against the texels' area averages, without the
/// worst 1 % of texels [%].
#[derive(Clone, Copy, Debug, Serialize)]
pub struct ErrorReport {
    /// What was aimed at.
    pub aimed: f64,
    /// Noise and bias together.
    pub estimated: f64,
    /// By two independent halves of the samples.
    pub noise: f64,
    /// By what is finer than blocks.
    pub bias: f64,
    /// What blocks saw in other light tells too little of this one.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub is_rough: bool,
}

/// Light probes and their files, relative to the output folder.
#[derive(Clone, Debug, Serialize)]
pub struct ProbeReport {
    pub count: usize,
    /// Those that stand inside of something.
    pub invalid: usize,
    pub files: [&'static str; 2],
}

/// A file that was read.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Input {
    pub path: PathBuf,
    /// Absent for a file inside an archive.
    pub sha256: Option<String>,
}

/// What the light of a group was multiplied by.
#[derive(Clone, Debug, Serialize)]
pub struct MixReport {
    pub group: String,
    /// By channel.
    pub weight: [f32; 3],
}

/// What was baked beside kept texels.
#[derive(Clone, Debug, Serialize)]
pub struct OnlyReport {
    /// What selects objects.
    pub patterns: Vec<String>,
    /// Surfaces that were baked: those selected, and those that no written page shows.
    pub surfaces: usize,
    pub baked_texels: usize,
    pub kept_texels: usize,
}

/// The differences of a bake to one that remembers nothing, by luminance, relative to the mean light [%]; [`crate::pipeline`] says
/// what they may be.
#[derive(Clone, Debug, Serialize)]
pub struct Verified {
    /// Whether they are no more than noise explains.
    pub holds: bool,
    /// Texels that were compared.
    pub texels: usize,
    /// Of the means.
    pub bias: f64,
    /// Root mean square, without the worst hundredth of the area.
    pub rms: f64,
    /// The noise that both bakes have together, as they estimate it.
    pub noise: f64,
    /// What noise explains: of `rms`, and of means.
    pub most_rms: f64,
    pub most_bias: f64,
    /// Of those surfaces of a hundredth of the area at least.
    pub worst: Option<WorstSurface>,
}

/// The surface whose mean differs most, for what its noise explains; relative to the mean light of all [%].
#[derive(Clone, Debug, Serialize)]
pub struct WorstSurface {
    pub name: String,
    /// Of its mean.
    pub bias: f64,
    /// Root mean square of all of its texels.
    pub rms: f64,
    /// What noise explains of `bias`.
    pub most_bias: f64,
}

impl Verified {
    /// It in one line.
    pub fn line(&self) -> String {
        let Self { bias, rms, noise, most_rms, most_bias, .. } = self;
        let worst = self.worst.as_ref().map_or(String::new(), |w| format!("; worst {} {:+.2} %", w.name, w.bias));
        format!(
            "{}: mean {bias:+.2} % (at most {most_bias:.2}), texels {rms:.2} % (at most {most_rms:.2}, by noise of {noise:.2}){worst}",
            if self.holds { "verified" } else { "NOT verified" },
        )
    }

    /// What to say where the difference is more than noise explains.
    pub fn warning(&self) -> Warnings {
        let mut warnings = Warnings::default();
        if !self.holds {
            let message = "differs from a bake that remembers nothing by more than noise explains; bake anew with --no-cache and without \
                           --only, and report it where the scene hasn't changed since what is kept was baked";
            warnings.add("verify", message);
        }
        warnings
    }
}

/// A surface and its place.
#[derive(Clone, Debug, Serialize)]
pub struct SurfaceReport {
    pub name: String,
    pub triangles: usize,
    /// What it does: `lit`, `casts only`, `receives only`, `vertex colours`, ... ([`crate::scene::Role::name`]).
    pub role: &'static str,
    /// Its own texels per metre.
    pub density: f32,
    /// Absent, with its rectangle, where no written page shows it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub page: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scale: Option<[f32; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub offset: Option<[f32; 2]>,
    /// Hexadecimal digits of a hash of the texels that it covers on the page.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub place: Option<String>,
}

/// Digits of places: enough to tell those of one name apart.
const PLACE_DIGITS: usize = 16;

/// A key of [`digest::places`] as reports tell it.
pub(crate) fn place_in_report(key: Key) -> String {
    let mut digits = key.to_string();
    digits.truncate(PLACE_DIGITS);
    digits
}

/// A page and its file.
#[derive(Clone, Debug, Serialize)]
pub struct PageReport {
    /// Relative to the output folder; absent without light.
    pub uri: Option<String>,
    pub width: u32,
    pub height: u32,
    /// `half` or `float`, what an OpenEXR page's channels are; absent in other forms.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub samples: Option<&'static str>,
    /// Share of the texels that are covered at least in part.
    pub utilisation: Option<f64>,
}

/// A layer of the pages.
#[derive(Clone, Debug, Serialize)]
pub struct LayerReport {
    pub name: String,
    /// Its channels in the pages.
    pub channels: Vec<String>,
    /// `1` for shares and directions.
    pub unit: &'static str,
    /// The light or group that it is of.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub of: Option<String>,
}

/// What was baked of a light.
#[derive(Clone, Debug, Serialize)]
pub struct LightReport {
    pub name: String,
    /// `baked`, `indirect` or `dynamic`: [`crate::scene::contribution`].
    pub bake: BakeMode,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub group: Option<String>,
}

/// A form that pages were written in.
#[derive(Clone, Debug, Serialize)]
pub struct EncodingReport {
    pub name: &'static str,
    /// Decoded texels times this are the values.
    pub scale: f32,
    /// Relative to the output folder, in page order.
    pub uris: Vec<String>,
}

/// Time a stage took.
#[derive(Clone, Debug, Serialize)]
pub struct StageTime {
    pub name: &'static str,
    pub wall_s: f64,
    /// Of the whole process.
    pub cpu_s: f64,
}

/// How the solver ended.
#[derive(Clone, Debug, Default, Serialize)]
pub struct SolverReport {
    pub name: &'static str,
    pub form_factors: FormFactors,
    pub elements: usize,
    /// Samples (segments) that form factors took; those of hemicubes and hemispheres are not among them.
    pub samples: u64,
    /// Shots or sweeps.
    pub iterations: u64,
    /// Estimated remaining change of the worst surface's mean radiosity, relative to it.
    pub residual: f64,
    /// Power that was not shot, or that the last sweep added [lm].
    pub unshot: f64,
    /// Absent for solvers without links.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub links: Option<LinkReport>,
    /// How it came to this.
    pub steps: Vec<Step>,
}

impl Report {
    /// Whether the light may have been found by one pass of a method that follows rays.
    fn may_be_one_pass(&self) -> bool {
        self.solver.is_none() && (self.settings.samples == Some(1) || self.settings.time_budget.is_some())
    }

    /// The result in a few lines for people.
    pub fn summary(&self) -> Vec<String> {
        let pages: Vec<String> = self.pages.iter().map(|p| format!("{} x {}", p.width, p.height)).collect();
        let is_lit = self.texels > 0;
        let what = if is_lit { format!("{} texels", self.texels) } else { format!("{} surfaces", self.surfaces.len()) };
        let (count, sizes) = (pages.len(), pages.join(", "));
        let mut lines = vec![format!("{what} at {:.4} texels/m on {count} page(s): {sizes}", self.density)];
        if let Some(AdaptiveReport { densities: d, quick_s, .. }) = &self.adaptive {
            let spread = format!("{:.4} to {:.4}, half of the area below {:.4}", d.least, d.most, d.median);
            lines.push(format!("texels/m of charts: {spread}; the quick bake took {quick_s:.1} s"));
        }
        if is_lit {
            let how = match &self.solver {
                None if self.mixed.is_some() => "mixed of light groups".to_string(),
                None => format!("traced by the method {}", self.settings.method.name()),
                Some(SolverReport { name, elements, iterations, .. }) if self.settings.iterations.is_some() => {
                    format!("{name} over {elements} elements, {iterations} iterations as asked")
                }
                Some(SolverReport { name, elements, residual, .. }) => {
                    format!("{name} over {elements} elements, residual {:.3} %", 100.0 * residual)
                }
            };
            lines.push(how);
            let (noise, balance) = (100.0 * self.noise, 100.0 * self.energy.imbalance);
            let noise = match (&self.error, self.settings.gather()) {
                (Some(error), _) => format!("estimated error {:.2} %", error.estimated),
                (None, Gather::None) => "noise not measured".to_string(),
                // One pass tells none.
                _ if self.noise == 0.0 && self.may_be_one_pass() => "noise unknown".to_string(),
                _ => format!("noise {noise:.2} %"),
            };
            match (self.energy.is_empty(), self.mixed.is_some()) {
                (_, true) => {}
                (true, false) => lines.push(noise),
                (false, false) => lines.push(format!("{noise}, energy balance {balance:+.3} %")),
            }
            let reused = self.reused.iter().filter(|(_, tally)| tally.reused > 0);
            let reused: Vec<String> =
                reused.map(|(kind, Tally { reused, anew })| format!("{kind} {reused} of {}", reused + anew)).collect();
            if !reused.is_empty() {
                lines.push(format!("from the cache: {}", reused.join(", ")));
            }
            let bright = self.pages.iter().filter(|p| p.samples == Some("float") && !self.settings.float).count();
            if bright > 0 {
                lines.push(format!("{bright} page(s) hold more than half floats do (65504): written as 32-bit floats"));
            }
            if let Some(OnlyReport { surfaces, baked_texels, kept_texels, .. }) = &self.only {
                lines.push(format!("baked {baked_texels} texels of {surfaces} surface(s), kept {kept_texels}"));
            }
            match &self.verified {
                Some(verified) => lines.push(verified.line()),
                None if self.settings.verify => {
                    lines.push("nothing that was remembered was used: there was nothing to verify".to_string());
                }
                None => {}
            }
            if let Some(v) = self.vertices.as_ref().filter(|v| v.mode != MeshMode::Given) {
                let (from, to, asked) = (v.given_triangles, v.triangles, v.error);
                let within = format!("{:.1} % of the area within {asked} %, 95 % within {:.2} %", v.within, v.p95);
                lines.push(format!("vertex colours: {from} triangles became {to}; {within}"));
            }
            if let Some(ProbeReport { count, invalid, .. }) = &self.probes {
                lines.push(format!("{count} light probe(s), {invalid} of them inside of something"));
            }
        }
        lines
    }

    /// Describes `probes`, where there are any.
    pub fn describe_probes(&mut self, probes: &LightProbes) {
        let invalid = probes.list.iter().filter(|p| !p.is_valid()).count();
        let count = probes.list.len();
        self.probes = (count > 0).then_some(ProbeReport { count, invalid, files: PROBE_FILES });
    }

    /// Describes the surfaces and pages of `baked`.
    pub fn describe(&mut self, baked: &Baked) {
        let (scene, atlas) = (baked.scene, baked.atlas);
        self.density = atlas.density;
        self.triangles = scene.triangle_count();
        let places = digest::places(scene, atlas);
        let describe = |i: usize| {
            let (s, placement) = (&scene.surfaces[i], atlas.is_shown(i).then(|| &atlas.placements[i]));
            SurfaceReport {
                name: s.name.clone(),
                triangles: scene.meshes[s.mesh].triangles.len(),
                role: s.role.name(),
                density: atlas.surface_density(scene, i),
                page: placement.map(|p| p.page),
                scale: placement.map(|p| p.scale.to_array()),
                offset: placement.map(|p| p.offset.to_array()),
                place: placement.map(|_| place_in_report(places[i])),
            }
        };
        self.surfaces = (0..scene.surfaces.len()).map(describe).collect();
        let light = |(name, contribution): (&String, &Contribution)| LightReport {
            name: name.clone(),
            bake: contribution.mode(),
            group: contribution.group.as_deref().map(str::to_owned),
        };
        let skies = scene.environment.iter().flat_map(Environment::each).map(|sky| (&sky.name, &sky.contribution));
        self.lights = scene.lights.iter().map(|l| (&l.name, &l.contribution)).chain(skies).map(light).collect();
        let layers = baked.lightmap.iter().flat_map(|lightmap| &lightmap.layers);
        let layer = |l: &Layer| LayerReport {
            name: l.name.clone(),
            channels: channel_names(&l.name, l.channels),
            unit: l.unit,
            of: l.of.clone(),
        };
        self.layers = layers.map(layer).collect();
        let forms = baked.encoded.iter().filter(|f| f.encoding != Encoding::Exr);
        self.encodings =
            forms.map(|f| EncodingReport { name: f.encoding.name(), scale: f.scale, uris: f.uris.clone() }).collect();
        self.pages = (atlas.pages.iter().take(atlas.shown_pages).enumerate())
            .map(|(page, &[width, height])| {
                let coverage = baked.lightmap.map(|l| l.pages[page].coverage.iter().filter(|c| **c > 0.0).count());
                let is_float = |l| self.settings.float || exceeds_half(l, page);
                let is_exr = baked.encoded.iter().any(|f| f.encoding == Encoding::Exr);
                PageReport {
                    samples: baked.lightmap.filter(|_| is_exr).map(|l| if is_float(l) { "float" } else { "half" }),
                    uri: baked.page_uris.get(page).cloned(),
                    width,
                    height,
                    utilisation: coverage.map(|c| c as f64 / (f64::from(width) * f64::from(height))),
                }
            })
            .collect();
    }
}

impl Input {
    /// Reads and hashes `path`.
    pub fn new(path: PathBuf) -> Self {
        let sha256 =
            std::fs::read(&path).ok().map(|bytes| Sha256::digest(&bytes).iter().map(|b| format!("{b:02x}")).collect());
        Self { path, sha256 }
    }
}

/// Times the stages as they begin.
pub struct Clock<'a> {
    progress: &'a dyn Progress,
    start: Instant,
    stages: std::sync::Mutex<Vec<(&'static str, Instant, ProcessTime)>>,
}

impl<'a> Clock<'a> {
    /// A clock that passes everything on to `progress`.
    pub fn new(progress: &'a dyn Progress) -> Self {
        Self { progress, start: Instant::now(), stages: Default::default() }
    }

    /// The times so far; the last stage ends now.
    pub fn stages(&self) -> Vec<StageTime> {
        let stages = self.stages.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let ends = stages.iter().skip(1).map(|s| (s.1, s.2)).chain([(Instant::now(), ProcessTime::now())]);
        (stages.iter().zip(ends))
            .map(|((name, wall, cpu), (wall_end, cpu_end))| StageTime {
                name,
                wall_s: wall_end.duration_since(*wall).as_secs_f64(),
                cpu_s: cpu_end.duration_since(*cpu).as_secs_f64(),
            })
            .collect()
    }
}

impl Progress for Clock<'_> {
    fn begin(&self, stage: &'static str, total: u64) {
        let now = (stage, Instant::now(), ProcessTime::now());
        self.stages.lock().unwrap_or_else(std::sync::PoisonError::into_inner).push(now);
        self.progress.begin(stage, total);
    }
    fn advance(&self, units: u64) {
        self.progress.advance(units);
    }
    fn cancelled(&self) -> bool {
        self.progress.cancelled()
    }
    fn elapsed(&self) -> std::time::Duration {
        self.start.elapsed()
    }
    fn ends_at(&self, end: std::time::Duration) {
        // The listener's own clock may have begun before this one.
        self.progress.ends_at(end + self.progress.elapsed().saturating_sub(self.elapsed()));
    }
    fn keeps(&self, what: &str) {
        self.progress.keeps(what);
    }
}

/// Refuses to write over the bake of another scene.
///
/// # Errors
/// `Invalid` where `folder` holds a report about a scene other than `scene`, and `overwrite` is not set.
pub fn refuse_other_bake(scene: &Path, folder: &Path, overwrite: bool) -> Result<()> {
    let path = folder.join("report.json");
    if overwrite || !path.exists() {
        return Ok(());
    }
    let baked = std::fs::read(&path).ok().and_then(|bytes| serde_json::from_slice::<serde_json::Value>(&bytes).ok());
    let name = baked.as_ref().and_then(|r| r.pointer("/inputs/0/path")).and_then(|p| p.as_str()).map(PathBuf::from);
    let same = name.as_ref().is_some_and(|n| n.canonicalize().ok() == scene.canonicalize().ok());
    if same {
        return Ok(());
    }
    let of = name.map_or_else(|| "something else".to_string(), |n| n.display().to_string());
    Err(Error::invalid(
        folder.display(),
        format!("holds the bake of {of}; choose another folder with -o, or --overwrite"),
    ))
}

/// The most memory that this process held [bytes].
pub fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse::<u64>().ok().map(|kib| kib * 1024)
}

/// The memory that this process may have at most: the machine's, or that of its control group (version 2 or 1) [bytes].
pub fn machine_memory() -> Option<u64> {
    let info = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = info.lines().find(|l| l.starts_with("MemTotal:"))?;
    let machine = line.split_whitespace().nth(1)?.parse::<u64>().ok()?.saturating_mul(1024);
    let limits = ["/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"];
    let read = |file: &&str| std::fs::read_to_string(file).ok()?.trim().parse::<u64>().ok();
    Some(limits.iter().filter_map(read).fold(machine, u64::min))
}
