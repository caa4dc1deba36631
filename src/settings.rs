//! What a bake is asked to do, and the presets behind it.

use crate::error::{Error, Result};
use crate::gather::GatherParams;
use crate::light::direct::DirectParams;
use crate::post::Quantity;
use crate::reference::{PathParams, Strategy};
use crate::solve::SolveParams;
use crate::transport::Effort;
use crate::unwrap::{Density, UnwrapParams, UvMode};
use crate::write::{BakedLights, GltfProfile};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Settings of a bake as a user gives them (command line or `lumel.toml`): an absent value is chosen by the quality preset.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Settings {
    /// Preset for every stage.
    pub quality: Quality,
    /// Everything on one page of N x N texels.
    pub resolution: Option<u32>,
    /// Texels per metre.
    pub density: Option<f32>,
    /// Size of each page [texels], where several may be used.
    pub page_size: Option<u32>,
    pub max_pages: Option<u32>,
    /// Empty texels between charts; default 2.
    pub padding: Option<u32>,
    pub uv: UvMode,
    pub uv_name: Option<String>,
    pub normals: Normals,
    pub quantity: Quantity,
    pub method: Method,
    /// 32-bit pages in place of half.
    pub float: bool,
    /// Interreflections counted; none: until the solution has converged.
    pub max_bounces: Option<u32>,
    /// Final gather rays a texel, or paths.
    pub samples: Option<u32>,
    pub seed: u32,
    /// Worker threads; none: one a core.
    pub threads: Option<usize>,
    /// Constant sky radiance [nit], added to a scene without a sky or in place of its own.
    pub sky: Option<[f32; 3]>,
    /// Latlong picture [nit] as the sky.
    pub environment: Option<PathBuf>,
    /// Forms of the GLB; none: engine and vertex.
    pub gltf: Option<Vec<GltfProfile>>,
    pub lights: BakedLights,
    /// Folder for numbered EXR files of the stages in between.
    pub dump_stages: Option<PathBuf>,
    /// Replace another scene's bake in the output folder.
    pub overwrite: bool,
}

/// Preset for every stage: draft for a first look, medium for daily work, high for delivery, production for proof.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Quality {
    Draft,
    #[default]
    Medium,
    High,
    Production,
}

/// How the light of a texel is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// Light exchanged between elements, and gathered by each texel.
    #[default]
    Radiosity,
    /// Paths from each texel: the reference, slower, with its standard error.
    Path,
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

/// What a preset sets, stage by stage.
#[derive(Clone, Copy, Debug, Serialize)]
struct Preset {
    /// Final gather rays a texel.
    gather_samples: u32,
    /// Elements that exchange light.
    elements: usize,
    /// Rays that probe each element.
    probe_rays: u32,
    /// Relative standard error of a form factor between elements.
    form_factor_error: f32,
    /// First shadow samples for polygons, and for each delta light.
    polygon_samples: u32,
    delta_samples: u32,
}

/// Brightness samples of a sky with a picture for each ray of the final gather.
const SKY_RATIO: f32 = 0.5;

/// Estimated remaining change of each surface's mean radiosity, relative to it, at which the solver ends.
const RESIDUAL: f64 = 1e-3;

impl Quality {
    fn preset(self) -> Preset {
        let preset = |gather_samples, elements, probe_rays, form_factor_error, polygon_samples, delta_samples| Preset {
            gather_samples,
            elements,
            probe_rays,
            form_factor_error,
            polygon_samples,
            delta_samples,
        };
        match self {
            Self::Draft => preset(64, 512, 256, 0.2, 8, 4),
            Self::Medium => preset(256, 1536, 512, 0.1, 16, 8),
            Self::High => preset(512, 3072, 1024, 0.1, 32, 8),
            Self::Production => preset(1024, 6144, 1024, 0.05, 64, 16),
        }
    }

    /// Paths a texel.
    fn path_samples(self) -> u32 {
        match self {
            Self::Draft => 64,
            Self::Medium => 256,
            Self::High => 1024,
            Self::Production => 4096,
        }
    }

    /// Texels that the scene is given where neither density nor resolution is set.
    pub fn texel_count(self) -> u64 {
        match self {
            Self::Draft => 1 << 16,
            Self::Medium => 1 << 18,
            Self::High => 1 << 20,
            Self::Production => 1 << 22,
        }
    }
}

impl Settings {
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
        within("page-size", self.page_size, 16, 16384)?;
        within("max-pages", self.max_pages, 1, 1024)?;
        within("padding", self.padding, 1, 64)?;
        within("max-bounces", self.max_bounces, 0, 100)?;
        within("samples", self.samples, 1, 65536)?;
        within("threads", self.threads, 1, 1024)?;
        if self.resolution.is_some() && (self.density.is_some() || self.page_size.is_some()) {
            return Err(Error::invalid("resolution", "chooses the density by itself; leave out density and page-size"));
        }
        if self.sky.is_some() && self.environment.is_some() {
            return Err(Error::invalid("sky", "is given together with environment; leave one out"));
        }
        if let Some(sky) = self.sky
            && sky.iter().any(|v| !v.is_finite() || *v < 0.0)
        {
            return Err(Error::invalid("sky", "radiance must be finite and not negative [nit]"));
        }
        Ok(())
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
            padding: self.padding.unwrap_or(2),
            uv: self.uv,
            uv_name: self.uv_name.clone(),
        }
    }

    fn gather_samples(&self) -> u32 {
        self.samples.unwrap_or(self.quality.preset().gather_samples).max(2)
    }

    /// The direct light stage's parameters.
    pub fn direct_params(&self) -> DirectParams {
        let preset = self.quality.preset();
        DirectParams {
            polygon_samples: preset.polygon_samples,
            delta_samples: preset.delta_samples,
            sky_ratio: SKY_RATIO,
            gather_samples: self.gather_samples(),
            shading_normals: self.normals == Normals::Shading,
            seed: self.seed,
        }
    }

    /// About how many elements exchange light.
    pub fn element_count(&self) -> usize {
        self.quality.preset().elements
    }

    /// The solver's parameters.
    pub fn solve_params(&self) -> SolveParams {
        let preset = self.quality.preset();
        let effort = Effort {
            relative_error: preset.form_factor_error,
            // The mean form factor of a closed scene, and a few times that: most light comes over larger ones.
            floor: 4.0 / preset.elements as f32,
            first_samples: 4,
            most_samples: 256,
        };
        SolveParams { probe_rays: preset.probe_rays, effort, max_bounces: self.max_bounces, residual: RESIDUAL }
    }

    /// The final gather's parameters.
    pub fn gather_params(&self) -> GatherParams {
        GatherParams { samples: self.gather_samples() }
    }

    /// The path tracer's parameters.
    pub fn path_params(&self) -> PathParams {
        PathParams {
            samples: self.samples.unwrap_or(self.quality.path_samples()).max(2),
            max_bounces: self.max_bounces,
            shading_normals: self.normals == Normals::Shading,
            strategy: Strategy::Combined,
            seed: self.seed,
        }
    }

    /// The GLBs to write.
    pub fn gltf_profiles(&self) -> &[GltfProfile] {
        self.gltf.as_deref().unwrap_or(&[GltfProfile::Engine, GltfProfile::Vertex])
    }
}
