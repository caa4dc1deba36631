//! Presets: one word for every stage.

use serde::{Deserialize, Serialize};

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

/// What a preset sets, stage by stage.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Preset {
    /// Error that blocks aim at [%].
    pub(super) error: f64,
    /// Final gather rays a texel.
    pub(super) gather_samples: u32,
    /// Elements that exchange light.
    pub(super) elements: usize,
    /// Rays that probe each element.
    pub(super) probe_rays: u32,
    /// Relative standard error of a form factor between elements.
    pub(super) form_factor_error: f32,
    /// Power that a link of the hierarchical solver may misplace, relative to all power.
    pub(super) link_error: f64,
    /// First shadow samples for each light; standard error of its shadows, relative to the light around.
    pub(super) first_samples: u32,
    pub(super) shadow_error: f32,
    /// Samples shared among the clusters of many lights, and of each light with a texture or shaping.
    pub(super) cluster_samples: u32,
}

impl Quality {
    pub(super) fn preset(self) -> Preset {
        let (gather_samples, elements, probe_rays, form_factor_error, link_error) = match self {
            Self::Draft => (64, 512, 256, 0.2, 1e-5),
            Self::Medium => (256, 1536, 512, 0.1, 3e-6),
            Self::High => (512, 3072, 1024, 0.1, 1e-6),
            Self::Production => (1024, 6144, 1024, 0.05, 3e-7),
        };
        let (first_samples, shadow_error, cluster_samples) = match self {
            Self::Draft => (1, 0.04, 8),
            Self::Medium => (2, 0.015, 16),
            Self::High => (4, 0.008, 32),
            Self::Production => (4, 0.003, 64),
        };
        let error = match self {
            Self::Draft => 5.0,
            Self::Medium => 2.0,
            Self::High => 1.0,
            Self::Production => 0.5,
        };
        Preset {
            error,
            gather_samples,
            elements,
            probe_rays,
            form_factor_error,
            link_error,
            first_samples,
            shadow_error,
            cluster_samples,
        }
    }

    /// Paths a texel.
    pub(super) fn path_samples(self) -> u32 {
        match self {
            Self::Draft => 64,
            Self::Medium => 256,
            Self::High => 1024,
            Self::Production => 4096,
        }
    }

    /// Rays of a light probe.
    pub(super) fn probe_rays(self) -> u32 {
        match self {
            Self::Draft => 384,
            Self::Medium => 1536,
            Self::High => 3072,
            Self::Production => 12288,
        }
    }

    /// Form factors for themselves: elements, relative standard error, rays that probe each element, hemicubes on each.
    pub(super) fn view_factors(self) -> (usize, f32, u32, u32) {
        match self {
            Self::Draft => (128, 0.05, 1 << 11, 16),
            Self::Medium => (256, 0.02, 1 << 13, 32),
            Self::High => (512, 0.005, 1 << 14, 64),
            Self::Production => (1024, 0.002, 1 << 16, 256),
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
