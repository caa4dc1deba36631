//! Refuses bakes, pictures and matrices of form factors that would be larger than was allowed, before the work begins; and pictures that
//! the machine's memory can't hold.
//!
//! The estimate of memory is what the process holds once the scene is loaded, and what texels and triangles take on top
//! of it by the figures that `tests/memory.rs` holds. It is an estimate: the light of a scene decides how many links
//! there are.

use crate::error::{Error, Result};
use crate::inspect;
use crate::integrate::metropolis;
use crate::light::mask::masked_lights;
use crate::load::Loaded;
use crate::post::{Directional, LayerKind};
use crate::report::{machine_memory, peak_memory};
use crate::scene::{Environment, Scene};
use crate::settings::{Gather, Method, Settings};
use crate::unwrap::Atlas;
use std::collections::BTreeSet;

/// Memory of a texel [bytes], and that of its links at an error of 1 %, which grows with the reciprocal of the error.
/// Measured on the Cornell box: 228 in all at 5 %, 280 at 2 %, 437 at 1 %.
const TEXEL_BYTES: f64 = 165.0;
const LINK_BYTES: f64 = 300.0;

/// Memory of a texel, and of a texel of a page [bytes], where directions are asked for: moments twice, and the layers.
const MOMENT_BYTES: [f64; 2] = [96.0, 48.0];

/// Memory of a triangle [bytes]: the tree, its UVs while they are made, and the written geometry.
const TRIANGLE_BYTES: f64 = 600.0;

/// The part of it that the tree takes.
const TREE_BYTES: f64 = 300.0;

/// Memory of a texel of a page [bytes]: what is written; and what it takes in each layer, and while light is told apart for one.
const PAGE_BYTES: f64 = 16.0;
const LAYER_BYTES: f64 = 12.0;
const APART_BYTES: f64 = 36.0;

/// Memory of a pair of elements [bytes]: its form factor and the error of it.
const PAIR_BYTES: f64 = 8.0;

/// Memory of a pixel of a picture [bytes]: sums and squares of its film, a pass, and the copies of which a file is written. Metropolis keeps
/// a film for each group of chains, and the means of all. Measured on pictures of 1400 squared: 103 to 112, Metropolis 373.
const PIXEL_BYTES: f64 = 110.0;
const CHAINS_BYTES: f64 = 36.0 * metropolis::GROUPS as f64;

/// How to make a bake smaller.
const LOWER: &str = "ask for a lower --density, --resolution or --quality";

/// Refuses a scene by the texels and memory that a bake would take, about, before it is unwrapped.
///
/// # Errors
/// `Invalid` naming the limit and what to lower.
pub fn check_scene(loaded: &Loaded, settings: &Settings) -> Result<()> {
    if is_unlimited(settings) {
        return Ok(());
    }
    let size = Size::estimated(loaded, settings);
    size.check(loaded, bake_bytes(&size, &loaded.scene, settings), LOWER, settings)
}

/// Refuses a layout by the texels of its pages.
///
/// # Errors
/// As [`check_scene`].
pub fn check_atlas(loaded: &Loaded, atlas: &Atlas, settings: &Settings) -> Result<()> {
    if is_unlimited(settings) {
        return Ok(());
    }
    let size = Size::of(loaded, atlas, settings);
    size.check(loaded, bake_bytes(&size, &loaded.scene, settings), LOWER, settings)
}

/// Refuses a matrix of form factors between about `elements`, before the scene is unwrapped, or by its layout.
///
/// # Errors
/// As [`check_scene`].
pub fn check_form_factors(loaded: &Loaded, atlas: Option<&Atlas>, elements: usize, settings: &Settings) -> Result<()> {
    if is_unlimited(settings) {
        return Ok(());
    }
    let size = atlas.map_or_else(|| Size::estimated(loaded, settings), |atlas| Size::of(loaded, atlas, settings));
    // Every surface has an element at least.
    let elements = elements.max(loaded.scene.surfaces.len()) as f64;
    let bytes = size.texels as f64 * TEXEL_BYTES + PAIR_BYTES * elements * elements;
    size.check(loaded, bytes, "ask for fewer --elements or a lower --density or --resolution", settings)
}

/// Refuses a picture of so many pixels by the memory that it would take, about: more than was allowed, or than the machine has.
///
/// # Errors
/// `Invalid` naming the limit and what to lower.
pub fn check_picture(loaded: &Loaded, [width, height]: [u32; 2], settings: &Settings) -> Result<()> {
    let pixels = f64::from(width) * f64::from(height);
    let chains = if settings.method == Method::Metropolis { CHAINS_BYTES } else { 0.0 };
    let picture = pixels * (PIXEL_BYTES + chains);
    let triangles = loaded.scene.triangle_count() as f64 * TREE_BYTES;
    let held = peak_memory().unwrap_or(0);
    let bytes = held.saturating_add((picture + triangles) as u64);
    let (name, most, raise) = match (settings.max_memory, machine_memory()) {
        (Some(most), _) if bytes > most => ("--max-memory", most, ", or raise the limit"),
        (_, Some(most)) if bytes > most => ("--size", most, "; this machine has no more"),
        _ => return Ok(()),
    };
    let message = format!(
        "about {} would be taken: {} for the scene as it is loaded, {} for {width} x {height} pixels by the method {}, the rest for \
         {} triangles; {} is allowed: make the picture smaller with --size{raise}",
        mebibytes(bytes),
        mebibytes(held),
        mebibytes(picture as u64),
        settings.method.name(),
        loaded.scene.triangle_count(),
        mebibytes(most),
    );
    Err(Error::invalid(name, message))
}

fn is_unlimited(settings: &Settings) -> bool {
    settings.max_texels.is_none() && settings.max_memory.is_none()
}

/// How large a run is.
struct Size {
    /// Covered texels.
    texels: u64,
    /// All texels of the pages.
    page_texels: u64,
}

impl Size {
    /// About as large as the scene will be.
    fn estimated(loaded: &Loaded, settings: &Settings) -> Self {
        let expected = inspect::estimate_of(&loaded.scene, settings);
        Self { texels: expected.texels, page_texels: expected.pages * u64::from(expected.page_size).pow(2) }
    }

    /// As large as the pages of `atlas`.
    fn of(loaded: &Loaded, atlas: &Atlas, settings: &Settings) -> Self {
        let page_texels = atlas.pages.iter().map(|[w, h]| u64::from(*w) * u64::from(*h)).sum();
        Self { texels: Self::estimated(loaded, settings).texels.min(page_texels), page_texels }
    }

    /// Refuses more texels than are allowed, and more memory: what is held, `bytes` on top and the triangles. `lower` is what to do.
    fn check(&self, loaded: &Loaded, bytes: f64, lower: &str, settings: &Settings) -> Result<()> {
        let texels = self.texels;
        if let Some(most) = settings.max_texels.filter(|most| texels > *most) {
            let message = format!("there would be about {texels} texels; {lower}, or raise the limit of {most}");
            return Err(Error::invalid("--max-texels", message));
        }
        let Some(most) = settings.max_memory else { return Ok(()) };
        let triangles = loaded.scene.triangle_count() as f64;
        let held = peak_memory().unwrap_or(0);
        let bytes = held.saturating_add((bytes + triangles * TRIANGLE_BYTES) as u64);
        if bytes > most {
            let message = format!(
                "about {} would be taken: {} for the scene as it is loaded, the rest for {texels} texels and {triangles} \
                 triangles; {lower}, make pictures smaller, or raise the limit of {}",
                mebibytes(bytes),
                mebibytes(held),
                mebibytes(most)
            );
            return Err(Error::invalid("--max-memory", message));
        }
        Ok(())
    }
}

/// Memory that the texels of a bake take [bytes].
fn bake_bytes(size: &Size, scene: &Scene, settings: &Settings) -> f64 {
    let (layers, apart) = layer_counts(scene, settings);
    let moments = if settings.directional == Directional::Off { [0.0; 2] } else { MOMENT_BYTES };
    size.texels as f64 * (texel_bytes(settings) + apart as f64 * APART_BYTES + moments[0])
        + size.page_texels as f64 * (PAGE_BYTES + layers as f64 * LAYER_BYTES + moments[1])
}

/// How many layers pages will have, at most, and how many of them are light that is told apart.
fn layer_counts(scene: &Scene, settings: &Settings) -> (usize, usize) {
    let groups = || {
        let lights = scene.lights.iter().map(|l| &l.contribution);
        let skies = scene.environment.iter().flat_map(Environment::each).map(|sky| &sky.contribution);
        let glows = scene.materials.iter().filter(|m| m.is_emissive()).map(|m| &m.contribution);
        lights.chain(skies).chain(glows).map(|c| &c.group).collect::<BTreeSet<_>>().len()
    };
    let count = |kind: &LayerKind| match kind {
        LayerKind::Bounces => (settings.bounce_layers() + 3, settings.bounce_layers() + 1),
        LayerKind::LightGroups => (groups(), groups()),
        LayerKind::ShadowMasks => (masked_lights(scene).0.len(), 1),
        LayerKind::Ao | LayerKind::BentNormal | LayerKind::SkyVisibility => (1, 1),
        LayerKind::Direct | LayerKind::Indirect | LayerKind::Caustics | LayerKind::Error | LayerKind::Emission => {
            (1, 0)
        }
    };
    settings.layers.iter().map(count).fold((0, 0), |sum, of| (sum.0 + of.0, sum.1 + of.1))
}

/// Memory that a texel takes at the error that is asked for [bytes].
fn texel_bytes(settings: &Settings) -> f64 {
    match settings.gather() {
        Gather::Blocks => TEXEL_BYTES + LINK_BYTES * 0.01 / settings.block_params().error,
        _ => TEXEL_BYTES,
    }
}

fn mebibytes(bytes: u64) -> String {
    format!("{} MiB", bytes.div_ceil(1 << 20))
}
