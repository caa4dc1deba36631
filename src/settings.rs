//! What a bake is asked to do, and the presets behind it.

pub mod bytes;
mod check;
mod outdoors;
mod percent;
mod probes;
mod quality;
mod remembered;

pub use outdoors::{ProjectorSetting, SkySetting};
pub use probes::{ProbeSet, ProbeSetting};
pub use quality::Quality;
pub use remembered::Relight;

use crate::blocks::BlockParams;
use crate::gather::GatherParams;
use crate::light::direct::DirectParams;
use crate::load::medium::MediumRequest;
use crate::load::{Edits, LampEdit, LoadOptions, MaterialEdit, ObjectEdit, Purpose};
use crate::meshing::{MeshMode, MeshParams};
use crate::post::denoise::{Denoise, DenoiseParams, scales::Scales};
use crate::post::layers::LayerParams;
use crate::post::{Directional, LayerKind, Quantity, gutter::Gutter, seam::SeamMode};
use crate::probe::ProbeParams;
use crate::reference::{PathParams, Strategy};
use crate::scatter::Surfaces;
use crate::scene::{BakeMode, Scene};
use crate::solve::{SolveParams, Solver};
use crate::transport::hemicube::HemicubeParams;
use crate::transport::{Effort, Method as FormFactors, TransportParams};
use crate::unwrap::{Density, DensityVolume, PageSizes, UnwrapParams, Unwrapper, UvMode};
use crate::view_factors::{self, ViewFactorParams};
use crate::work::Shard;
use crate::write::encode::Encoding;
use crate::write::engines::{Engine, LightmapExtension};
use crate::write::{BakedLights, GltfProfile, VertexColors};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Settings of a bake as a user gives them (command line or `lumel.toml`): an absent value is chosen by the quality preset.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Settings {
    /// Preset for every stage.
    pub quality: Quality,
    /// The moment that moving parts are read at: seconds in glTF, a time code in USD; none: at rest, or the default time.
    pub time: Option<f64>,
    /// glTF: the animation that `time` is of, by name or number from 0; none: the first one.
    pub animation: Option<String>,
    /// Variants to read in place of the default: names in glTF, `PRIM:SET=NAME` in USD.
    pub variant: Vec<String>,
    /// Levels that USD's subdivision surfaces are refined to; 0: their control cages.
    pub subdivide: u32,
    /// USD's purposes that are drawn beside the default one; none: render.
    pub purpose: Vec<Purpose>,
    /// Folder that the scene and everything it names must lie in; none: glTF keeps to the scene's own, USD reads from anywhere.
    pub confine: Option<PathBuf>,
    /// Input that is missing or can't be read ends the run before it begins, in place of a warning.
    pub strict: bool,
    /// Texels of a picture, at most.
    pub max_texture: Option<u64>,
    /// Texels that a bake may have.
    pub max_texels: Option<u64>,
    /// Memory that a bake may take, by an estimate [bytes].
    #[serde(deserialize_with = "bytes::read")]
    pub max_memory: Option<u64>,
    /// Everything on one page of N x N texels.
    pub resolution: Option<u32>,
    /// Texels per metre.
    pub density: Option<f32>,
    /// How far texels go where light varies, as a quick bake tells, at the same number of texels in all: 0: not at all; 1: as far as
    /// makes the error least; none: 0.
    pub adaptive_density: Option<f32>,
    /// Size of each page [texels], where several may be used.
    pub page_size: Option<u32>,
    pub max_pages: Option<u32>,
    /// Sizes that pages may have.
    pub pages: PageSizes,
    /// Empty texels between charts; default 2, or what `mips` asks for.
    pub padding: Option<u32>,
    /// Mip levels, the full size among them, that KTX2 pages hold, and that are read without mixing charts: padding of 2^N texels at
    /// least; none: 1, and padding as it is.
    pub mips: Option<u32>,
    /// Side of the blocks of texels of which none holds two charts; none: charts lie anywhere.
    pub align: Option<u32>,
    /// Least side of a chart [texels]; none: 1.
    pub min_chart: Option<u32>,
    pub unwrapper: Unwrapper,
    pub uv: UvMode,
    pub uv_name: Option<String>,
    pub normals: Normals,
    pub quantity: Quantity,
    /// The engine that the result goes into: a note beside it says how to load it. The command chooses what else it wants.
    #[serde(rename = "for")]
    pub engine: Option<Engine>,
    /// Forms that pages are written in; none: OpenEXR.
    pub encoding: Option<Vec<Encoding>>,
    pub method: Method,
    /// What of materials is seen by methods that follow rays.
    pub surfaces: Surfaces,
    /// Light that comes to texels from lights over mirrors and glass alone is added to radiosity's direct light, by photons.
    pub caustics: bool,
    /// Which filter takes noise out.
    pub denoise: Denoise,
    /// The library of Open Image Denoise; none: looked for by its usual names.
    pub oidn_library: Option<PathBuf>,
    /// Between which charts light is made to agree.
    pub seams: SeamMode,
    /// What the space between charts holds.
    pub gutter: Gutter,
    /// Parts of the light that pages hold as layers of their own.
    pub layers: Vec<LayerKind>,
    /// How far away things occlude in the layers ao and bent-normal [m]; 0: however far; none: 1.
    pub ao_distance: Option<f32>,
    /// What pages tell of the directions that light comes from, for materials with normal maps.
    pub directional: Directional,
    /// Light probes, for objects without a lightmap.
    pub probes: Option<ProbeSetting>,
    /// 32-bit pages in place of half.
    pub float: bool,
    pub solver: Solver,
    pub form_factors: FormFactors,
    /// Cells along an edge of a hemicube's top.
    pub hemicube: Option<u32>,
    /// Elements that exchange light; as many as texels or more: each texel is one.
    pub elements: Option<usize>,
    /// Power that a link of the hierarchical solver may misplace, relative to all power.
    pub link_error: Option<f64>,
    /// Shots or sweeps after which the solver stops; none: once it has converged.
    pub iterations: Option<u64>,
    /// Progressive refinement sends ahead what the shooter is about to receive.
    pub overshoot: bool,
    /// Adds the ambient term for light that is not shot yet.
    pub ambient: bool,
    pub gather: Gather,
    /// Estimated error at which to stop [%]: the root mean square of noise and bias together over the mean light, against the
    /// texels' area averages, without the worst 1 % of texels.
    #[serde(deserialize_with = "percent::read", serialize_with = "percent::write")]
    pub error: Option<f64>,
    /// Time for the whole bake [s], writing included; the best result within it, or within `error` sooner.
    pub time_budget: Option<f64>,
    /// Interreflections counted; none: until the solution has converged.
    pub max_bounces: Option<u32>,
    /// Final gather rays a texel, or paths.
    pub samples: Option<u32>,
    pub seed: u32,
    /// Worker threads; none: one a core.
    pub threads: Option<usize>,
    /// A constant sky or the clear one around `sun`, added to a scene without a sky or in place of its own.
    pub sky: Option<SkySetting>,
    /// A sun: degrees above the horizon, degrees clockwise from north (-Z), illuminance at normal incidence [lx].
    pub sun: Option<[f32; 3]>,
    /// Latlong picture [nit] as the sky.
    pub environment: Option<PathBuf>,
    /// Forms of the GLB; none: engine and vertex.
    pub gltf: Option<Vec<GltfProfile>>,
    /// Form of the vertex GLB's `COLOR_0`.
    pub vertex_colors: VertexColors,
    /// Extension by which the engine GLB names its pages, besides its extras.
    pub gltf_lightmap_ext: Option<LightmapExtension>,
    /// How meshes with vertex colours follow the light.
    pub mesh: MeshMode,
    /// How far values between vertices may miss the light [%]: see [`MeshParams::error`]; none: 5.
    #[serde(deserialize_with = "percent::read", serialize_with = "percent::write")]
    pub vertex_error: Option<f64>,
    /// Triangles with vertex colours, at most; none: as many as the error takes.
    pub max_triangles: Option<u64>,
    pub lights: BakedLights,
    /// What of the light of lights is baked that say nothing about it; skies and emissive materials are always baked then.
    pub bake_lights: BakeMode,
    /// Pictures that lights are to throw.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub projectors: Vec<ProjectorSetting>,
    /// Participating media that are added to the scene's own.
    #[serde(rename = "medium", skip_serializing_if = "Vec::is_empty")]
    pub media: Vec<MediumRequest>,
    /// Where texels are finer or coarser.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub density_volumes: Vec<DensityVolume>,
    /// What objects do in the bake, by pattern.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub objects: Vec<ObjectEdit>,
    /// What materials are taken to be, by pattern.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub materials: Vec<MaterialEdit>,
    /// How the scene's lights shine, by pattern.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub lamps: Vec<LampEdit>,
    /// Folder for numbered EXR files of the stages in between.
    pub dump_stages: Option<PathBuf>,
    /// Folder for pages of the solution as it grows.
    pub watch: Option<PathBuf>,
    /// Shots or sweeps between two of them; none: chosen by the solver.
    pub watch_every: Option<u64>,
    /// Patterns over the paths of objects that alone are baked: the texels of the others stay as they are in the output folder; none: all
    /// are baked.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub only: Vec<String>,
    /// Bakes again without what is remembered, where something was used, and compares.
    #[serde(skip_serializing)]
    pub verify: bool,
    /// Replace another scene's bake in the output folder.
    pub overwrite: bool,
    /// Lays out all surfaces anew, though the places of some are known from an earlier bake.
    #[serde(skip_serializing)]
    pub fresh_places: bool,
    /// Folder of results that later bakes find again; none: nothing is kept.
    #[serde(skip_serializing)]
    pub cache: Option<PathBuf>,
    /// A bake lets go of what it didn't use itself, the oldest first, until no more than this is in the cache [bytes]; none: all stays.
    #[serde(skip_serializing, deserialize_with = "bytes::read")]
    pub cache_limit: Option<u64>,
    /// Work that takes longer is put into the cache part by part, from then on [s]; none: 60.
    #[serde(skip_serializing)]
    pub checkpoint: Option<f64>,
    /// This process does a bake together with others, which share its cache.
    #[serde(skip_serializing)]
    pub shard: Option<Shard>,
    /// The light is found by what blocks saw in the light of an earlier bake, however rough that is; none: it is a bake of its own.
    #[serde(skip)]
    pub relight: Option<Relight>,
}

/// How texels get their interreflected light from the solution.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Gather {
    /// [`Gather::Blocks`], unless something is asked for that only elements have.
    #[default]
    Auto,
    /// Blocks of texels gather together, as many and with as many samples as the error asks for.
    Blocks,
    /// By a final gather over each texel's own hemisphere: the reference.
    Final,
    /// As their element has it.
    None,
}

/// How the light of a texel is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// Light exchanged between surfaces, by blocks of texels or by elements and a gather ([`Gather`]).
    #[default]
    Radiosity,
    /// Paths from each texel: the reference, slower, with its standard error.
    Path,
    /// Light straight from what shines, over mirrors and through glass.
    Ray,
    /// Paths from sensors and from lights, joined: for light that is hard to find from either side.
    Bidirectional,
    /// Chains of such paths, each a small change of the one before where that brings light (Metropolis light transport).
    Metropolis,
    /// Photons sent out from what shines, read by walks: light over mirrors and glass, and in fog.
    Photon,
}

impl Method {
    /// The name by which it is asked for.
    pub fn name(self) -> &'static str {
        match self {
            Self::Radiosity => "radiosity",
            Self::Path => "path",
            Self::Ray => "ray",
            Self::Bidirectional => "bidirectional",
            Self::Metropolis => "metropolis",
            Self::Photon => "photon",
        }
    }

    /// True of all but radiosity.
    pub fn follows_rays(self) -> bool {
        self != Self::Radiosity
    }
}

/// The normal that irradiance is about.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Normals {
    /// The interpolated one where authored.
    #[default]
    Shading,
    /// The triangle's.
    Geometric,
}

/// Cells along an edge of a hemicube's top, and hemicubes for each element: elements are small, one would nearly do.
const HEMICUBE: u32 = 64;
const HEMICUBE_POINTS: u32 = 4;

/// Elements at most: about 2 GB.
const MOST_ELEMENTS: usize = 1 << 22;

/// First shadow rays from a patch to each light where an error is asked for.
const FIRST_SHADOW_SAMPLES: u32 = 2;

/// How much a light in a shadow may be off, of an error that is asked for: few texels lie in one.
const SHADOW_PART: f32 = 2.0;

/// Errors that can be asked for [%].
const LEAST_ERROR: f64 = 0.05;
const MOST_ERROR: f64 = 50.0;

/// The least error of vertex colours that can be asked for [%].
const LEAST_VERTEX_ERROR: f64 = 0.1;

/// Samples of blocks where an error or a time is asked for, for each texel on average, at most.
const MOST_SAMPLES: u32 = 4096;

/// So many times as many a texel where some objects alone are baked: hard ones have no easy ones beside them whose samples they could use.
const MORE_SAMPLES: u32 = 2;

/// Shots or sweeps at most.
const MOST_ITERATIONS: u64 = 1_000_000_000;

/// Distance at which things occlude by default [m]: what lies further away, an indoor scene's walls, would blacken it throughout.
const AO_DISTANCE: f32 = 1.0;

/// Bounces that `--layers bounces` tells apart, at most; the last holds the rest.
const MOST_BOUNCE_LAYERS: usize = 12;

/// How far values between vertices may miss the light [%].
const VERTEX_ERROR: f64 = 5.0;

/// Estimated remaining change of each surface's mean radiosity, relative to it, at which the solver ends.
pub const RESIDUAL: f64 = 1e-3;

impl Settings {
    /// How the scene file is read.
    pub fn load_options(&self) -> LoadOptions {
        LoadOptions {
            time: self.time,
            animation: self.animation.clone(),
            variants: self.variant.clone(),
            subdivide: self.subdivide,
            purpose: self.purpose.clone(),
            edits: self.edits(),
            confine: self.confine.clone(),
            max_texture: self.max_texture,
            max_memory: self.max_memory,
            appearance: (self.method.follows_rays() || self.caustics) && self.surfaces == Surfaces::Full,
            strict: self.strict,
        }
    }

    /// What is changed of the scene.
    pub(crate) fn edits(&self) -> Edits {
        Edits { objects: self.objects.clone(), materials: self.materials.clone(), lamps: self.lamps.clone() }
    }

    /// The unwrap stage's parameters.
    pub fn unwrap_params(&self) -> UnwrapParams {
        let density = match (self.resolution, self.density) {
            (Some(size), _) => Density::FillPage(size),
            (None, Some(density)) => Density::TexelsPerMetre(density),
            (None, None) => Density::TexelCount(self.quality.texel_count()),
        };
        UnwrapParams {
            density,
            page_size: self.page_size.unwrap_or(2048),
            max_pages: self.max_pages.unwrap_or(64),
            pages: self.pages,
            padding: self.padding.unwrap_or(2).max(self.mips.map_or(0, |levels| 1 << levels)),
            align: self.align.unwrap_or(1),
            min_chart: self.min_chart.unwrap_or(1),
            uv: self.uv,
            uv_name: self.uv_name.clone(),
            unwrapper: self.unwrapper,
            volumes: self.density_volumes.clone(),
            importance: None,
        }
    }

    fn gather_samples(&self) -> u32 {
        self.samples.unwrap_or(self.quality.preset().gather_samples)
    }

    /// The direct light stage's parameters.
    pub fn direct_params(&self) -> DirectParams {
        let preset = self.quality.preset();
        let (first_samples, shadow_error) = match self.error {
            Some(error) => (FIRST_SHADOW_SAMPLES, (SHADOW_PART * error as f32 / 100.0).clamp(0.002, 0.04)),
            None => (preset.first_samples, preset.shadow_error),
        };
        DirectParams {
            first_samples,
            shadow_error,
            cluster_samples: preset.cluster_samples,
            time: self.time_budget,
            shading_normals: self.normals == Normals::Shading,
            moments: self.directional != Directional::Off,
            seed: self.seed,
            unit: 0,
        }
    }

    /// About how many elements exchange light.
    pub fn element_count(&self) -> usize {
        self.elements.unwrap_or(self.quality.preset().elements)
    }

    /// The solver's parameters for so many elements.
    pub fn solve_params(&self, elements: usize) -> SolveParams {
        let preset = self.quality.preset();
        let effort = Effort {
            relative_error: preset.form_factor_error,
            // The mean form factor of a closed scene, and a few times that: most light comes over larger ones. Among more
            // elements errors average out, so each may be larger in proportion to the mean.
            floor: 4.0 / (elements as f32 * preset.elements as f32).sqrt(),
            first_samples: 4,
            most_samples: 256,
        };
        SolveParams {
            solver: self.solver,
            transport: TransportParams {
                method: self.form_factors,
                effort,
                hemicube: HemicubeParams {
                    resolution: self.hemicube.unwrap_or(HEMICUBE),
                    points: HEMICUBE_POINTS,
                    rotate: true,
                },
                probe_rays: preset.probe_rays,
            },
            // A final gather adds the last bounce.
            max_bounces: self.max_bounces.map(|k| if self.gather == Gather::None { k } else { k.saturating_sub(1) }),
            iterations: self.iterations,
            residual: RESIDUAL,
            link_error: self.link_error.unwrap_or(preset.link_error),
            overshoot: self.overshoot,
            ambient: self.ambient,
            bounces: self.bounce_layers(),
        }
    }

    /// The parameters of form factors that are wanted for themselves.
    ///
    /// # Errors
    /// `Invalid` where there would be more elements than a matrix may have.
    pub fn view_factor_params(&self) -> crate::Result<ViewFactorParams> {
        let (elements, relative_error, probe_rays, points) = self.quality.view_factors();
        let elements = self.elements.unwrap_or(elements);
        view_factors::refuse_too_many(elements)?;
        let hemicube = HemicubeParams { resolution: self.hemicube.unwrap_or(HEMICUBE), points, rotate: true };
        let (method, direct, seed) = (self.form_factors, self.direct_params(), self.seed);
        Ok(ViewFactorParams { method, elements, relative_error, hemicube, probe_rays, direct, seed })
    }

    /// Every path that is given, but for the cache and for a library, which is looked for by its name.
    pub fn paths_mut(&mut self) -> Vec<&mut PathBuf> {
        let own = [&mut self.environment, &mut self.confine, &mut self.dump_stages, &mut self.watch];
        let own = own.into_iter().flatten();
        let grids = self.media.iter_mut().filter_map(|medium| medium.grid.as_mut());
        own.chain(self.projectors.iter_mut().map(|projector| &mut projector.picture)).chain(grids).collect()
    }

    /// How texels get their light.
    pub fn gather(&self) -> Gather {
        match self.gather {
            Gather::Auto if self.method.follows_rays() || self.asks_for_elements() => Gather::Final,
            Gather::Auto => Gather::Blocks,
            chosen => chosen,
        }
    }

    /// True where something is set that means nothing to blocks.
    fn asks_for_elements(&self) -> bool {
        self.for_elements().is_some()
    }

    /// The first setting that means nothing to blocks, where one is set.
    fn for_elements(&self) -> Option<&'static str> {
        let all = [
            (self.solver != Solver::Auto, "solver"),
            (self.form_factors != FormFactors::Area, "form-factors"),
            (self.hemicube.is_some(), "hemicube"),
            (self.elements.is_some(), "elements"),
            (self.link_error.is_some(), "link-error"),
            (self.iterations.is_some(), "iterations"),
            (self.overshoot, "overshoot"),
            (self.ambient, "ambient"),
            (self.samples.is_some(), "samples"),
            (self.watch.is_some(), "watch"),
        ];
        all.iter().find(|(is_set, _)| *is_set).map(|(_, name)| *name)
    }

    /// The error that blocks aim at: a share, not a percentage.
    fn aimed_error(&self) -> f64 {
        let in_time = self.time_budget.map(|_| LEAST_ERROR);
        self.error.or(in_time).unwrap_or(self.quality.preset().error) / 100.0
    }

    /// The parameters of the exchange between blocks.
    pub fn block_params(&self) -> BlockParams {
        // Whoever asks for an error or a time has said how long it may take.
        let is_preset = self.error.is_none() && self.time_budget.is_none();
        let most = match (is_preset, self.only.is_empty()) {
            (false, _) => MOST_SAMPLES,
            (true, true) => self.quality.preset().gather_samples,
            (true, false) => (MORE_SAMPLES * self.quality.preset().gather_samples).min(MOST_SAMPLES),
        };
        BlockParams {
            error: self.aimed_error(),
            most_samples: f64::from(most),
            time: self.time_budget,
            max_bounces: self.max_bounces,
            residual: RESIDUAL,
            layers: !self.layers.is_empty(),
            halves: self.denoise_params().filter != Denoise::Off,
            seed: self.seed,
        }
    }

    /// How noise is taken out, the filter chosen. Paths are the reference, and stay as they are unless a filter is named.
    pub fn denoise_params(&self) -> DenoiseParams {
        let filter = match self.denoise {
            Denoise::Auto if self.method.follows_rays() => Denoise::Off,
            Denoise::Auto => Denoise::Builtin,
            chosen => chosen,
        };
        let scales = if self.gather() == Gather::Blocks { Scales::BLOCKS } else { Scales::SINGLE };
        DenoiseParams { filter, scales, library: self.oidn_library.clone() }
    }

    /// The final gather's parameters.
    pub fn gather_params(&self) -> GatherParams {
        GatherParams { samples: self.gather_samples() }
    }

    /// Bounces that layers tell apart, at most.
    pub fn bounce_layers(&self) -> usize {
        if self.layers.contains(&LayerKind::Bounces) { MOST_BOUNCE_LAYERS } else { 0 }
    }

    /// What is asked of layers.
    pub fn layer_params(&self) -> LayerParams {
        let distance = self.ao_distance.unwrap_or(AO_DISTANCE);
        LayerParams {
            wanted: self.layers.clone(),
            quantity: self.quantity,
            samples: self.quality.preset().gather_samples,
            ao_distance: (distance > 0.0).then_some(distance),
            seed: self.seed,
        }
    }

    /// The probes of `scene`; none where none are asked for.
    ///
    /// # Errors
    /// `Invalid` where there would be too many.
    pub fn probe_params(&self, scene: &Scene) -> crate::Result<ProbeParams> {
        let sets = self.probes.as_ref().map_or(Ok(Vec::new()), |probes| probes.placements(scene))?;
        Ok(ProbeParams { sets, rays: self.quality.probe_rays(), seed: self.seed })
    }

    /// The path tracer's parameters.
    pub fn path_params(&self) -> PathParams {
        PathParams {
            samples: self.samples.unwrap_or(self.quality.path_samples()),
            max_bounces: self.max_bounces,
            shading_normals: self.normals == Normals::Shading,
            strategy: Strategy::Combined,
            seed: self.seed,
        }
    }

    /// How light gets to vertices.
    pub fn mesh_params(&self) -> MeshParams {
        let error = self.vertex_error.unwrap_or(VERTEX_ERROR) / 100.0;
        MeshParams { mode: self.mesh, error, max_triangles: self.max_triangles }
    }

    /// The forms that pages are written in: those asked for, or OpenEXR, and one that the extension can name.
    pub fn encodings(&self) -> Vec<Encoding> {
        let mut all = self.encoding.clone().unwrap_or_else(|| vec![Encoding::Exr]);
        let named = self.gltf_lightmap_ext.map_or(&[][..], LightmapExtension::encodings);
        if !named.is_empty() && !named.iter().any(|e| all.contains(e)) {
            all.push(named[0]);
        }
        all
    }

    /// The GLBs to write.
    pub fn gltf_profiles(&self) -> &[GltfProfile] {
        self.gltf.as_deref().unwrap_or(&[GltfProfile::Engine, GltfProfile::Vertex])
    }
}
