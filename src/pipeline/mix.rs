//! Light groups of a bake weighed against each other: pages are linear in the light, so that the sum of the groups' layers, each by its
//! weight, is the page that lights of these strengths would have left, seams and gutters included.

use super::pages::Pages;
use super::remembered::Remembered;
use super::{Shown, finish, open};
use crate::color::Rgb;
use crate::compare::{Page, ReadLayer};
use crate::error::{Error, Result};
use crate::illuminate::texels;
use crate::patch::Patches;
use crate::post::layers::GROUP;
use crate::post::{Directional, Layer, LayerKind, Lightmap, PageImage};
use crate::probe::LightProbes;
use crate::progress::Progress;
use crate::report::{Clock, MixReport, Report};
use crate::settings::Settings;
use crate::unwrap::Atlas;
use std::path::Path;

/// Covered by more than this share, a texel of a page must be one of the scene's.
const COVERED: f32 = 0.01;

/// What the light of a group is multiplied by.
#[derive(Clone, Debug, PartialEq)]
pub struct Weight {
    pub group: String,
    /// By channel; not negative.
    pub by: Rgb,
}

/// Bakes the scene file `scene` anew from the light groups in the output folder `baked`, each by its weight, into the folder `folder`.
///
/// # Errors
/// `Invalid` where there are no groups, or none of a name, or pages aren't of this scene; those of the stages.
pub fn mix(
    scene: &Path,
    baked: &Path,
    folder: &Path,
    settings: &Settings,
    weights: &[Weight],
    progress: &dyn Progress,
) -> Result<Report> {
    if let (Ok(a), Ok(b)) = (baked.canonicalize(), folder.canonicalize())
        && a == b
    {
        return Err(Error::invalid(folder.display(), "holds the groups that are mixed; choose another folder with -o"));
    }
    let clock = Clock::new(progress);
    clock.begin("pages", 0);
    let read = Pages::read(baked, "bake with --encoding exr among others, and --layers light-groups")?;
    read.check(baked, weights)?;
    let is_lossy = settings.directional != Directional::Off || settings.probes.is_some();
    let settings = &of_mix(settings);
    let (mut report, loaded, _lock) = open(scene, folder, settings, &clock)?;
    let remembered = Remembered::open(scene, settings)?;
    let (atlas, _) = remembered.lay_out(&loaded, settings, true, &clock, &mut report)?;
    let work = remembered.work(&loaded.scene, &atlas, settings);
    let (patches, exposure) = texels(&loaded.scene, &atlas, settings, &work, &clock)?;
    read.refuse_others(&atlas, &patches, baked)?;
    clock.begin("mix", 0);
    for name in read.lost() {
        report.warnings.add(name, "a layer of the bake can't be mixed of light groups and is left out");
    }
    if is_lossy {
        report.warnings.add("probes, directional", "aren't told apart by light groups, and are left out of the mix");
    }
    for surface in loaded.scene.surfaces.iter().filter(|s| s.role.receives && !s.role.lightmapped) {
        report.warnings.add(&surface.name, "has its light at vertices alone, which no page holds: it is black there");
    }
    let lightmap = read.mixed(&atlas, settings, weights);
    report.warnings.extend(remembered.store.take_warnings());
    report.texels = patches.len();
    report.buried_texels = exposure.buried_count();
    report.mixed =
        Some(weights.iter().map(|w| MixReport { group: w.group.clone(), weight: w.by.to_array() }).collect());
    let probes = LightProbes::default();
    let shown = Shown { patches: &patches, exposure: &exposure, lightmap: &lightmap, probes: &probes };
    finish(&loaded, &atlas, Some(shown), folder, settings, &clock, report)
}

/// The settings of a bake as far as they say something of a mix.
fn of_mix(settings: &Settings) -> Settings {
    let layers = settings.layers.iter().copied();
    let stays = |kind: &LayerKind| {
        use LayerKind::{Ao, BentNormal, LightGroups, ShadowMasks, SkyVisibility};
        matches!(kind, LightGroups | Ao | BentNormal | SkyVisibility | ShadowMasks)
    };
    Settings {
        layers: layers.filter(stays).collect(),
        directional: Directional::Off,
        probes: None,
        shard: None,
        relight: None,
        only: Vec::new(),
        verify: false,
        ..settings.clone()
    }
}

/// True of layers that other light doesn't change.
fn is_of_places(name: &str) -> bool {
    matches!(name, "ao" | "bent-normal" | "sky-visibility") || name.starts_with("shadow.")
}

impl Pages {
    /// The names of the groups.
    fn groups(&self) -> Vec<&str> {
        self.layers[0].iter().filter_map(|layer| layer.name.strip_prefix(GROUP)).collect()
    }

    /// The names of layers that are neither of groups nor of places.
    fn lost(&self) -> impl Iterator<Item = &str> {
        let names = self.layers[0].iter().map(|layer| layer.name.as_str());
        names.filter(|name| !name.starts_with(GROUP) && !is_of_places(name))
    }

    /// Refuses pages without groups, and weights of none.
    fn check(&self, folder: &Path, weights: &[Weight]) -> Result<()> {
        let known = self.groups();
        if known.is_empty() {
            let message = "its pages hold no light groups to be mixed; bake with --layers light-groups";
            return Err(Error::invalid(folder.display(), message));
        }
        for (k, Weight { group, .. }) in weights.iter().enumerate() {
            if !known.contains(&group.as_str()) {
                let message = format!("is no light group of this bake; there are {}", known.join(", "));
                return Err(Error::invalid(group, message));
            }
            if weights[..k].iter().any(|other| other.group == *group) {
                return Err(Error::invalid(group, "is given two weights; leave one out"));
            }
        }
        Ok(())
    }

    /// Refuses pages that aren't of the texels `patches`.
    fn refuse_others(&self, atlas: &Atlas, patches: &Patches, folder: &Path) -> Result<()> {
        let sizes = self.pages.iter().map(|page| [page.width, page.height]);
        let own = atlas.pages.iter().take(atlas.shown_pages).map(|size| size.map(|n| n as usize));
        let covers = |(number, page): (usize, &Page)| {
            let mut covered = page.coverage.iter().enumerate().filter(|(_, share)| **share > COVERED);
            covered.all(|(texel, _)| patches.at(number, texel).is_some())
        };
        if sizes.eq(own) && self.pages.iter().enumerate().all(covers) {
            return Ok(());
        }
        let message = "its pages aren't laid out as this scene is now: the scene has changed, or its texels went where the light \
                       varies and the cache that tells where is gone; bake anew";
        Err(Error::invalid(folder.display(), message))
    }

    /// The pages that the groups add up to, each by its weight, and those layers that stay.
    fn mixed(self, atlas: &Atlas, settings: &Settings, weights: &[Weight]) -> Lightmap {
        let Self { pages, layers: mut read, of, .. } = self;
        let weight = |name: &str| {
            let group = name.strip_prefix(GROUP)?;
            Some(weights.iter().find(|w| w.group == group).map_or(Rgb::ONE, |w| w.by))
        };
        for layer in read.iter_mut().flatten() {
            let Some(by) = weight(&layer.name) else { continue };
            layer.values.iter_mut().for_each(|value| *value *= by);
        }
        let mut images = Vec::new();
        for (page, layers) in pages.into_iter().zip(&read) {
            let mut rgb = vec![Rgb::ZERO; page.rgb.len()];
            for layer in layers.iter().filter(|layer| weight(&layer.name).is_some()) {
                rgb.iter_mut().zip(&layer.values).for_each(|(sum, value)| *sum += *value);
            }
            let (width, height) = (page.width as u32, page.height as u32);
            images.push(PageImage { width, height, rgb, coverage: page.coverage });
        }
        // Nothing tells of the light on hidden pages.
        for &[width, height] in &atlas.pages[atlas.shown_pages..] {
            let texels = width as usize * height as usize;
            images.push(PageImage { width, height, rgb: vec![Rgb::ZERO; texels], coverage: vec![0.0; texels] });
        }
        let hidden: Vec<usize> = images[atlas.shown_pages..].iter().map(|image| image.rgb.len()).collect();
        let mut layers = Vec::new();
        for (k, of) in of.into_iter().enumerate() {
            let ReadLayer { name, channels, unit, .. } = &read[0][k];
            if weight(name).is_none() && !is_of_places(name) {
                continue;
            }
            let (name, channels, unit) = (name.clone(), *channels, *unit);
            let shown = read.iter_mut().map(|of_page| std::mem::take(&mut of_page[k].values));
            let pages = shown.chain(hidden.iter().map(|&texels| vec![Rgb::ZERO; texels])).collect();
            layers.push(Layer { name, pages, channels, unit, of });
        }
        Lightmap { pages: images, quantity: settings.quantity, layers }
    }
}
