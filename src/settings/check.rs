//! Settings that are refused before any work begins: out of range, or of no effect beside others.

use super::{Gather, LEAST_ERROR, LEAST_VERTEX_ERROR, MOST_ELEMENTS, MOST_ERROR, MOST_ITERATIONS, Method, Settings};
use crate::error::{Error, Result};
use crate::load::image::MOST_TEXELS;
use crate::meshing::MeshMode;
use crate::post::{Directional, LayerKind, Quantity, denoise::Denoise};
use crate::scatter::Surfaces;
use crate::scene::BakeMode;
use crate::solve::{Solver, full_matrix};
use crate::transport::Method as FormFactors;
use crate::unwrap::PageSizes;
use crate::write::encode::Encoding;
use crate::write::engines::LightmapExtension;
use crate::write::{GltfProfile, VertexColors};

/// Levels of subdivision, at most: each has four times the faces of the one before.
const MOST_SUBDIVISION: u32 = 8;

impl Settings {
    /// Refuses what can't be shared out.
    fn check_shards(&self) -> Result<()> {
        let fault = |place: &str, message: &str| Err(Error::invalid(place, message));
        if self.cache.is_none() {
            return fault("shard", "shards share what they find in a cache; give one with --cache");
        }
        if self.method != Method::Radiosity || self.gather() != Gather::Blocks {
            return fault(
                "shard",
                "what is shared out is the radiosity of blocks; leave method, solver and gather out",
            );
        }
        if self.time_budget.is_some() {
            return fault(
                "shard",
                "what is done in a given time is another thing on each machine; leave time-budget out",
            );
        }
        Ok(())
    }

    /// Refuses what isn't found by what blocks saw.
    fn check_relight(&self) -> Result<()> {
        refuse_first(&[
            (
                self.method != Method::Radiosity || self.gather() != Gather::Blocks,
                "relight",
                "other light is found for the radiosity of blocks alone; bake by it, without method, solver and gather",
            ),
            (self.cache.is_none(), "relight", "other light is found by what a cache remembers; name it with --cache"),
            (
                self.shard.is_some(),
                "relight",
                "nothing is traced, and so there is nothing to share out; leave shard out",
            ),
        ])
    }

    /// Refuses what can't be baked beside texels that are kept.
    fn check_only(&self) -> Result<()> {
        let has = |kind| self.layers.contains(&kind);
        refuse_first(&[
            (
                self.method != Method::Radiosity || self.gather() != Gather::Blocks,
                "only",
                "selected objects are baked by the radiosity of blocks alone; leave out method, solver and gather, or only",
            ),
            (self.shard.is_some(), "only", "a bake of selected objects isn't shared out; leave out shard, or only"),
            (self.relight.is_some(), "only", "other light is found for all objects at once; leave it out"),
            (
                self.max_bounces.is_some_and(|bounces| bounces > 0),
                "max-bounces",
                "kept pages don't tell how often their light was reflected; leave it out, or only",
            ),
            (
                self.caustics,
                "caustics",
                "photons that mirrors and glass send on reach all objects; leave it out, or only",
            ),
            (
                has(LayerKind::Bounces),
                "layers",
                "kept pages don't tell how often their light was reflected; leave out bounces, or only",
            ),
            (
                has(LayerKind::LightGroups) && self.quantity == Quantity::Radiosity,
                "layers",
                "groups of radiosity hold what surfaces emit, too, which can't be told apart on kept pages; leave out light-groups, or only",
            ),
            (
                self.bake_lights == BakeMode::Indirect,
                "bake-lights",
                "pages don't show direct light that kept objects send on; leave it out, or only",
            ),
        ])
    }

    /// Refuses values out of range before any work begins.
    ///
    /// # Errors
    /// `Invalid`, naming the setting and its range.
    pub fn check(&self) -> Result<()> {
        fn within<T: PartialOrd + std::fmt::Display>(name: &str, value: Option<T>, low: T, high: T) -> Result<()> {
            match value {
                Some(v) if v < low || v > high || v.partial_cmp(&low).is_none() => {
                    Err(Error::invalid(name, format!("{v} is out of range; allowed are {low} to {high}")))
                }
                _ => Ok(()),
            }
        }
        within("resolution", self.resolution, 16, 16384)?;
        within("density", self.density, 1e-4, 1e5)?;
        within("adaptive-density", self.adaptive_density, 0.0, 1.0)?;
        within("page-size", self.page_size, 16, 16384)?;
        within("max-pages", self.max_pages, 1, 1024)?;
        within("padding", self.padding, 1, 64)?;
        within("mips", self.mips, 1, 6)?;
        within("min-chart", self.min_chart, 1, 64)?;
        within("max-texture", self.max_texture, 1, MOST_TEXELS)?;
        within("max-texels", self.max_texels, 1, u64::MAX)?;
        within("max-memory", self.max_memory, 1 << 20, u64::MAX)?;
        within("max-bounces", self.max_bounces, 0, 100)?;
        let least = if self.method == Method::Radiosity { 2 } else { 1 };
        within("samples", self.samples, least, 65536)?;
        within("threads", self.threads, 1, 1024)?;
        within("elements", self.elements, 1, MOST_ELEMENTS)?;
        within("hemicube", self.hemicube, 8, 1024)?;
        if self.hemicube.is_some_and(|cells| cells % 2 != 0) {
            return Err(Error::invalid("hemicube", "the number of cells must be even: 8, 10, ... 1024"));
        }
        within("link-error", self.link_error, 1e-12, 1e-2)?;
        within("iterations", self.iterations, 1, MOST_ITERATIONS)?;
        within("watch-every", self.watch_every, 1, MOST_ITERATIONS)?;
        within("error", self.error, LEAST_ERROR, MOST_ERROR)?;
        within("vertex-error", self.vertex_error, LEAST_VERTEX_ERROR, 100.0)?;
        within("max-triangles", self.max_triangles, 1, 1 << 32)?;
        within("checkpoint", self.checkpoint, 0.0, 1e6)?;
        if self.shard.is_some() {
            self.check_shards()?;
        }
        if self.relight.is_some() {
            self.check_relight()?;
        }
        if !self.only.is_empty() {
            self.check_only()?;
        }
        refuse_first(&[
            (self.verify && self.shard.is_some(), "verify", "is for whole bakes; give it to the one that ends them"),
            (
                self.verify && self.time_budget.is_some(),
                "verify",
                "what is baked in a given time depends on the machine; leave out verify, or time-budget",
            ),
        ])?;
        within("time", self.time, -1e9, 1e9)?;
        within("ao-distance", self.ao_distance, 0.0, 1e6)?;
        within("subdivide", Some(self.subdivide), 0, MOST_SUBDIVISION)?;
        within("time-budget", self.time_budget, 0.1, 1e6)?;
        self.check_blocks()?;
        for volume in &self.density_volumes {
            if let Some(fault) = volume.fault() {
                return Err(Error::invalid("density-volumes", fault));
            }
        }
        for medium in &self.media {
            medium.own_shape().map_err(|fault| Error::invalid("medium", fault))?;
        }
        self.check_layers()?;
        self.check_pages()?;
        self.check_gather()?;
        self.check_solver()?;
        self.check_denoise()?;
        if self.resolution.is_some() && (self.density.is_some() || self.page_size.is_some()) {
            return Err(Error::invalid("resolution", "chooses the density by itself; leave out density and page-size"));
        }
        if self.sky.is_some() && self.environment.is_some() {
            return Err(Error::invalid("sky", "is given together with environment; leave one out"));
        }
        self.edits().check()?;
        self.probes.as_ref().map_or(Ok(()), |probes| probes.check())?;
        super::outdoors::check(self.sky, self.sun, &self.projectors)
    }

    /// Refuses forms of pages that don't go together.
    fn check_pages(&self) -> Result<()> {
        let encodings = self.encoding.as_deref().unwrap_or(&[Encoding::Exr]);
        let has_exr = encodings.contains(&Encoding::Exr);
        let extension = self.gltf_lightmap_ext;
        let is_double = |(k, e)| encodings[..k].contains(e);
        let is_cut = self.mesh != MeshMode::Given;
        let has_vertex_glb = self.gltf_profiles().contains(&GltfProfile::Vertex);
        let has_engine_glb = self.gltf_profiles().contains(&GltfProfile::Engine);
        refuse_first(&[
            (encodings.is_empty(), "encoding", "names no form; leave it out for exr"),
            (encodings.iter().enumerate().any(is_double), "encoding", "names a form twice"),
            (self.float && !has_exr, "float", "is about exr, which encoding leaves out"),
            (!self.layers.is_empty() && !has_exr, "layers", "only exr holds layers; add it to encoding"),
            (is_cut && !has_vertex_glb, "mesh", "is about vertex colours, which gltf leaves out; add vertex to it"),
            (
                !is_cut && self.max_triangles.is_some(),
                "max-triangles",
                "is about meshes that follow the light; choose the mesh adaptive or discontinuity",
            ),
            (
                self.vertex_colors != VertexColors::Float && !has_vertex_glb,
                "vertex-colors",
                "is for the GLB vertex, which gltf leaves out; add vertex to it",
            ),
            (
                extension.is_some() && !has_engine_glb,
                "gltf-lightmap-ext",
                "is for the GLB engine, which gltf leaves out",
            ),
            (
                extension.is_some() && self.quantity == Quantity::Radiosity,
                "gltf-lightmap-ext",
                "viewers multiply by the albedo, and radiosity holds it already; choose another quantity",
            ),
            (
                extension == Some(LightmapExtension::Needle) && self.quantity != Quantity::Irradiance,
                "gltf-lightmap-ext",
                "Needle Engine has no factor for lightmaps and reads E; choose the quantity irradiance",
            ),
        ])
    }

    /// Refuses sizes of pages that can't be had, and blocks that don't fill them.
    fn check_blocks(&self) -> Result<()> {
        if self.resolution.is_some() && self.pages == PageSizes::Free {
            return Err(Error::invalid("pages", "resolution asks for one page of N x N texels; leave one of them out"));
        }
        let Some(align) = self.align else { return Ok(()) };
        if !align.is_power_of_two() || align > 64 {
            return Err(Error::invalid("align", format!("{align} is no power of two from 1 to 64")));
        }
        let side = self.resolution.or(self.page_size).unwrap_or(align);
        if !side.is_multiple_of(align) {
            let message = format!("blocks of {align} texels don't fill a page of {side}; choose a multiple of {align}");
            return Err(Error::invalid("align", message));
        }
        Ok(())
    }

    fn check_layers(&self) -> Result<()> {
        let is_directional = self.directional != Directional::Off;
        let has = |kind| self.layers.contains(&kind);
        let is_double = |(k, kind)| self.layers[..k].contains(kind);
        refuse_first(&[
            (self.layers.iter().enumerate().any(is_double), "layers", "names a layer twice"),
            (
                has(LayerKind::Bounces) && self.method.follows_rays(),
                "layers",
                "methods that follow rays don't tell bounces apart; leave out bounces, or choose the method radiosity",
            ),
            (
                has(LayerKind::Bounces) && self.iterations.is_some(),
                "layers",
                "bounces are those of the whole solution; leave out bounces, or iterations",
            ),
            (
                has(LayerKind::LightGroups) && self.gather() != Gather::Blocks,
                "layers",
                "light groups are told apart by blocks alone; leave out light-groups, or what needs elements or paths",
            ),
            (
                self.caustics && self.method.follows_rays(),
                "caustics",
                "is for the method radiosity; other methods hold light over mirrors and glass already",
            ),
            (
                self.caustics && self.surfaces == Surfaces::Diffuse,
                "caustics",
                "needs mirrors and glass, which surfaces diffuse leaves out",
            ),
            (
                has(LayerKind::Caustics) && !self.caustics,
                "layers",
                "caustics are light that the setting caustics adds; give it as well",
            ),
            (
                self.ao_distance.is_some() && !has(LayerKind::Ao) && !has(LayerKind::BentNormal),
                "ao-distance",
                "is for the layers ao and bent-normal, and neither is asked for",
            ),
            (
                self.method.follows_rays() && self.bake_lights == BakeMode::Indirect,
                "bake-lights",
                "rays don't tell direct light of some lights from that of others; leave it out, or choose the method radiosity",
            ),
            (
                has(LayerKind::Error) && self.gather == Gather::None,
                "layers",
                "without a gather no error is known; leave out error, or gather none",
            ),
            (
                is_directional && self.gather == Gather::None,
                "directional",
                "elements know no directions; leave it out, or gather none",
            ),
            (
                is_directional && self.quantity == Quantity::Radiosity,
                "directional",
                "what a surface sends out is the same all round; choose the quantity outgoing or irradiance",
            ),
        ])
    }

    fn check_denoise(&self) -> Result<()> {
        let is_asked = matches!(self.denoise, Denoise::Builtin | Denoise::Oidn);
        refuse_first(&[
            (
                is_asked && self.gather == Gather::None,
                "denoise",
                "without a gather no noise is known; leave it out, or gather none",
            ),
            (
                self.oidn_library.is_some() && self.denoise != Denoise::Oidn,
                "oidn-library",
                "is for denoise oidn, which is not chosen",
            ),
        ])
    }

    /// Refuses what the way to gather has no use for.
    fn check_gather(&self) -> Result<()> {
        let is_blocks = self.gather() == Gather::Blocks;
        let other = match (self.gather, self.for_elements()) {
            _ if self.method.follows_rays() => format!("method {}", self.method.name()),
            (Gather::Final, _) => "gather final".to_string(),
            (Gather::None, _) => "gather none".to_string(),
            (_, option) => option.unwrap_or_default().to_string(),
        };
        let for_blocks = format!("is for gather blocks, and {other} goes another way; leave out one of them");
        let of_elements = self.for_elements().unwrap_or_default();
        let no_elements = format!("blocks have links of their own: leave out {of_elements}, which is about other ways");
        refuse_first(&[
            (self.error.is_some() && !is_blocks, "error", &for_blocks),
            (self.time_budget.is_some() && !is_blocks && !self.method.follows_rays(), "time-budget", &for_blocks),
            (self.gather == Gather::Blocks && self.asks_for_elements(), "gather", &no_elements),
        ])
    }

    /// Refuses what the solver can't do, and what would be ignored.
    fn check_solver(&self) -> Result<()> {
        if self.solver == Solver::FullMatrix {
            full_matrix::refuse_too_many(self.element_count())?;
        }
        let is_path = self.method.follows_rays();
        let for_radiosity = "does nothing with methods that follow rays; leave it out";
        let is_auto = self.solver == Solver::Auto;
        let is_progressive = is_auto || self.solver == Solver::Progressive;
        let is_full = self.solver == Solver::FullMatrix;
        let is_linked = self.solver == Solver::Hierarchical;
        refuse_first(&[
            (is_path && !is_auto, "solver", for_radiosity),
            (is_path && self.form_factors != FormFactors::Area, "form-factors", for_radiosity),
            (is_path && self.hemicube.is_some(), "hemicube", for_radiosity),
            (is_path && self.link_error.is_some(), "link-error", for_radiosity),
            (is_path && self.iterations.is_some(), "iterations", for_radiosity),
            (is_path && self.overshoot, "overshoot", for_radiosity),
            (is_path && self.ambient, "ambient", for_radiosity),
            (is_path && self.gather != Gather::Auto, "gather", for_radiosity),
            (is_path && self.watch.is_some(), "watch", for_radiosity),
            (
                self.watch_every.is_some() && self.watch.is_none(),
                "watch-every",
                "says how often to write into the folder of watch, which is not given",
            ),
            (
                self.gather == Gather::None && self.samples.is_some(),
                "samples",
                "are those of the final gather, and gather none has none; leave it out",
            ),
            (is_full && self.iterations.is_some(), "iterations", "full-matrix solves at once; choose another solver"),
            (
                is_full && self.watch.is_some(),
                "watch",
                "full-matrix solves at once, there is nothing to watch; choose another solver",
            ),
            (self.overshoot && !is_progressive, "overshoot", "only the solver progressive shoots"),
            (self.ambient && !is_progressive, "ambient", "only the solver progressive has unshot light"),
            (
                self.ambient && self.iterations.is_none() && self.watch.is_none(),
                "ambient",
                "stands in for light that is not shot yet, and in the end all is; give iterations or watch as well",
            ),
            (self.ambient && self.max_bounces.is_some(), "ambient", "holds all bounces; leave it out, or max-bounces"),
            (
                is_linked && self.form_factors != FormFactors::Area,
                "form-factors",
                "links of the hierarchical solver are found by area sampling; leave it out, or choose another solver",
            ),
            (
                self.link_error.is_some() && !is_linked,
                "link-error",
                "is for the solver hierarchical, which is not chosen",
            ),
            (
                self.hemicube.is_some() && self.form_factors != FormFactors::Hemicube,
                "hemicube",
                "is the resolution for form-factors hemicube, which is not chosen",
            ),
            (
                self.max_bounces.is_some() && (is_full || self.solver == Solver::GaussSeidel),
                "max-bounces",
                "this solver doesn't tell bounces apart; choose jacobi, progressive or hierarchical",
            ),
            (
                self.max_bounces.is_some() && self.overshoot,
                "max-bounces",
                "overshooting mixes the bounces; leave out overshoot",
            ),
        ])
    }
}

/// Refuses the first of (wrong, setting, message) that is wrong.
fn refuse_first(all: &[(bool, &str, &str)]) -> Result<()> {
    match all.iter().find(|r| r.0) {
        Some((_, setting, message)) => Err(Error::invalid(*setting, message)),
        None => Ok(()),
    }
}
