//! Links: where the light of a block comes from. A link is one direction in which a block sees a patch; it knows neither light nor
//! colour nor bounce, so that the same links serve every sweep, channel and lamp.
//!
//! The irradiance of a block about the normal n is `E(n) = sum over links of L max(0, n d) w`. Directions come from two strategies,
//! the hemisphere and areas that shine ([`Guide`](super::guide::Guide)), and are combined by the balance heuristic (Veach, Guibas
//! 1995): `w = 1 / (N_h p_h + N_a p_a)`. Of a block that is curved each texel sees a hemisphere of its own, and p_h is the mixture of
//! them all: a direction that one texel drew is of use to each texel that faces it.

use super::guide::{Found, Guide, NO_CLUSTER, Recipe, View};
use crate::color::Rgb;
use crate::sample::octahedral;
use glam::Vec3;
use std::f32::consts::{FRAC_1_PI, PI};

/// Set in a target: its back is seen.
const BACK: u32 = 1 << 31;

/// The least share of a hemisphere that a mixture is taken to cover: normals of a few texels stand for all.
const LEAST_MIXTURE: f32 = 1e-2;

/// Sums further off than this say that too little was drawn to tell.
const LEAST_SCALE: f32 = 0.5;

/// A surface that is seen: 12 bytes.
#[derive(Clone, Copy, Debug)]
pub struct Link {
    target: u32,
    /// Packed unit direction.
    direction: u32,
    /// Density [1/sr] with which its cluster would have been hit there.
    pdf_area: f32,
}

/// A piece of the sky that is seen.
#[derive(Clone, Copy, Debug)]
pub struct SkyLink {
    direction: u32,
    known: Found,
}

impl Link {
    /// The patch `patch`, on its back where `back`, seen along `direction` (unit).
    pub fn new(patch: usize, back: bool, direction: Vec3, pdf_area: f32) -> Self {
        Self { target: target(patch, back), direction: octahedral::pack(direction), pdf_area }
    }

    /// The patch, and whether its back is seen.
    pub fn target(&self) -> (usize, bool) {
        ((self.target & !BACK) as usize, self.target & BACK != 0)
    }

    /// Unit, away from the block.
    pub fn direction(&self) -> Vec3 {
        octahedral::unpack(self.direction)
    }

    /// As it is put down.
    pub fn to_words(self) -> [u32; 3] {
        [self.target, self.direction, self.pdf_area.to_bits()]
    }

    /// The link that was put down so.
    pub fn from_words([target, direction, pdf]: [u32; 3]) -> Self {
        Self { target, direction, pdf_area: f32::from_bits(pdf) }
    }
}

impl SkyLink {
    /// The sky along `direction` (unit).
    pub fn new(direction: Vec3, known: Found) -> Self {
        Self { direction: octahedral::pack(direction), known }
    }

    /// Unit, away from the block.
    pub fn direction(&self) -> Vec3 {
        octahedral::unpack(self.direction)
    }

    /// As it is put down.
    pub fn to_words(self) -> [u32; 3] {
        [self.direction, u32::from(self.known.cluster), self.known.pdf.to_bits()]
    }

    /// The link that was put down so.
    pub fn from_words([direction, cluster, pdf]: [u32; 3]) -> Self {
        Self { direction, known: Found { cluster: cluster as u16, pdf: f32::from_bits(pdf) } }
    }
}

/// The way of a link.
#[derive(Clone, Copy, Debug)]
struct Way {
    direction: u32,
    pdf_area: f32,
}

/// Links, with what every sweep reads of them in one place: 4 bytes each where their ways don't matter any more, else 12.
#[derive(Clone, Debug, Default)]
pub struct Links {
    targets: Vec<u32>,
    /// One a target, or none.
    ways: Vec<Way>,
}

impl Links {
    /// So many links may come.
    pub fn reserve_exact(&mut self, count: usize) {
        self.targets.reserve_exact(count);
        self.ways.reserve_exact(count);
    }

    /// So many links without ways may come.
    pub fn reserve_targets(&mut self, count: usize) {
        self.targets.reserve_exact(count);
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.targets.len()
    }

    /// True where there are none.
    pub fn is_empty(&self) -> bool {
        self.targets.is_empty()
    }

    /// True where their ways are known.
    pub fn have_ways(&self) -> bool {
        self.ways.len() == self.targets.len()
    }

    /// Adds a link; without a way where others have none.
    pub fn push(&mut self, link: Link) {
        if self.have_ways() {
            self.ways.push(Way { direction: link.direction, pdf_area: link.pdf_area });
        }
        self.targets.push(link.target);
    }

    /// Adds a link to the patch `patch`, to its back where `back`, of which the way doesn't matter: it has none, nor has any other.
    pub fn push_target(&mut self, patch: usize, back: bool) {
        self.targets.push(target(patch, back));
    }

    /// Gives the links the `directions` (unit) that they go along.
    pub fn direct(&mut self, directions: impl Iterator<Item = Vec3>) {
        let way = |direction| Way { direction: octahedral::pack(direction), pdf_area: 0.0 };
        self.ways.clear();
        self.ways.reserve_exact(self.targets.len());
        self.ways.extend(directions.take(self.targets.len()).map(way));
    }

    /// Link `k`. Without a way it goes nowhere in particular.
    #[inline]
    pub fn get(&self, k: usize) -> Link {
        let Way { direction, pdf_area } = self.ways.get(k).copied().unwrap_or(Way { direction: 0, pdf_area: 0.0 });
        Link { target: self.targets[k], direction, pdf_area }
    }

    /// The links, in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Link> + Clone {
        (0..self.targets.len()).map(|k| self.get(k))
    }

    /// What they see: patches, and whether it is their backs.
    #[inline]
    pub fn targets(&self) -> impl ExactSizeIterator<Item = (usize, bool)> {
        self.targets.iter().map(|target| ((target & !BACK) as usize, target & BACK != 0))
    }

    /// Adds all of `others`.
    fn extend(&mut self, others: Self) {
        others.iter().for_each(|link| self.push(link));
    }

    fn retain(&mut self, keep: &[bool]) {
        if !keep.contains(&false) {
            return;
        }
        let mut kept = keep.iter();
        self.targets.retain(|_| *kept.next().expect("one a link"));
        let mut kept = keep.iter();
        self.ways.retain(|_| *kept.next().expect("one a link"));
    }

    fn shrink_to_fit(&mut self) {
        self.targets.shrink_to_fit();
        self.ways.shrink_to_fit();
    }
}

fn target(patch: usize, back: bool) -> u32 {
    patch as u32 | if back { BACK } else { 0 }
}

/// What one of the two independent halves of a block's samples found.
#[derive(Clone, Debug, Default)]
pub struct Half {
    pub links: Links,
    /// Form factor of each link: `w / pi` times the mean cosine over the block.
    pub weights: Vec<f32>,
    pub sky: Vec<SkyLink>,
    /// Form factor of each link to the sky.
    pub sky_weights: Vec<f32>,
    /// Directions over the hemisphere that found nothing that sends light.
    pub lost: u32,
    /// Places of links, and of those to the sky, whose light has come through coloured panes, ascending, with the tint: what the light is
    /// multiplied by. Few bakes have any.
    pub tints: Vec<(u32, Rgb)>,
    pub sky_tints: Vec<(u32, Rgb)>,
}

/// Each of `links` with its form factor and tint.
fn tinted<'a, L>(
    links: impl Iterator<Item = L> + 'a,
    weights: &'a [f32],
    tints: &'a [(u32, Rgb)],
) -> impl Iterator<Item = (L, f32, Rgb)> {
    let mut tints = tints.iter().peekable();
    (0..).zip(links).zip(weights).map(move |((k, link), weight)| {
        let tint = tints.next_if(|t| t.0 == k).map_or(Rgb::ONE, |t| t.1);
        (link, *weight, tint)
    })
}

/// Keeps those of the `weights` of links and their `tints` that are told to.
fn retain(weights: &mut Vec<f32>, tints: &mut Vec<(u32, Rgb)>, keep: &[bool]) {
    if !keep.contains(&false) {
        return;
    }
    let mut place = 0;
    let places: Vec<u32> = keep
        .iter()
        .map(|keep| {
            place += u32::from(*keep);
            place
        })
        .collect();
    tints.retain(|(k, _)| keep[*k as usize]);
    tints.iter_mut().for_each(|(k, _)| *k = places[*k as usize] - 1);
    let mut kept = keep.iter();
    weights.retain(|_| *kept.next().expect("one a link"));
}

impl Half {
    /// The links with their form factors and tints.
    pub fn seen(&self) -> impl Iterator<Item = (Link, f32, Rgb)> {
        tinted(self.links.iter(), &self.weights, &self.tints)
    }

    /// The same of those to the sky.
    pub fn sky_seen(&self) -> impl Iterator<Item = (&SkyLink, f32, Rgb)> {
        tinted(self.sky.iter(), &self.sky_weights, &self.sky_tints)
    }

    /// Adds a link whose light is multiplied by `tint`.
    pub fn push(&mut self, link: Link, tint: Rgb) {
        if tint != Rgb::ONE {
            self.tints.push((self.links.len() as u32, tint));
        }
        self.links.push(link);
    }

    /// Adds one to the sky.
    pub fn push_sky(&mut self, link: SkyLink, tint: Rgb) {
        if tint != Rgb::ONE {
            self.sky_tints.push((self.sky.len() as u32, tint));
        }
        self.sky.push(link);
    }

    /// Keeps the links, and those to the sky, that are wanted.
    pub fn retain(&mut self, link: impl Fn(&Link) -> bool, sky: impl Fn(&SkyLink) -> bool) {
        let keep: Vec<bool> = self.links.iter().map(|l| link(&l)).collect();
        retain(&mut self.weights, &mut self.tints, &keep);
        self.links.retain(&keep);
        let keep: Vec<bool> = self.sky.iter().map(sky).collect();
        retain(&mut self.sky_weights, &mut self.sky_tints, &keep);
        let mut kept = keep.iter();
        self.sky.retain(|_| *kept.next().expect("one a link"));
    }

    /// Adds the `fresh` links of a half, in place of those that it lacks; where nothing is lost, form factors add up to 1 again.
    pub fn join(&mut self, fresh: Self) {
        let is_closed = fresh.lost == 0 && self.lost == 0;
        let (first, first_sky) = (self.links.len() as u32, self.sky.len() as u32);
        self.links.extend(fresh.links);
        self.weights.extend(fresh.weights);
        self.tints.extend(fresh.tints.iter().map(|(k, tint)| (first + k, *tint)));
        self.sky.extend(fresh.sky);
        self.sky_weights.extend(fresh.sky_weights);
        self.sky_tints.extend(fresh.sky_tints.iter().map(|(k, tint)| (first_sky + k, *tint)));
        if is_closed {
            self.close(&Drawn::default());
        }
    }

    /// Scales the form factors so that those of all that is seen, the lost directions included, add up to 1: no light is made or lost
    /// by the noise of both strategies together.
    pub fn close(&mut self, drawn: &Drawn) {
        let found: f32 = self.weights.iter().chain(&self.sky_weights).sum();
        let sum = found + self.lost as f32 / drawn.hemisphere.max(1) as f32;
        let scale = if sum > 0.0 { sum.recip().clamp(LEAST_SCALE, LEAST_SCALE.recip()) } else { 1.0 };
        self.weights.iter_mut().chain(&mut self.sky_weights).for_each(|weight| *weight *= scale);
        // Links are most of what a bake holds: room for more would be as much again.
        self.links.shrink_to_fit();
        self.weights.shrink_to_fit();
        self.sky.shrink_to_fit();
        self.sky_weights.shrink_to_fit();
    }
}

/// What each half has drawn, with what it found and what it didn't.
#[derive(Clone, Debug, Default)]
pub struct Drawn {
    /// Directions over the hemisphere, and towards what shines.
    pub hemisphere: u32,
    pub areas: u32,
    /// How the latter were drawn, and how many each way.
    views: Vec<(Recipe, u32)>,
    pub normals: Normals,
}

/// The normals of a block: one where it is flat, else of texels all over it.
#[derive(Clone, Debug, Default)]
pub struct Normals(pub Vec<Vec3>);

impl Normals {
    /// Mean over the block of max(0, n d), which is pi times the density of the hemispheres' mixture; and the share of the block that
    /// faces `direction`, from which area samples can go that way.
    pub fn facing(&self, direction: Vec3) -> (f32, f32) {
        let (mut sum, mut count) = (0.0, 0u32);
        for n in &self.0 {
            let cos = n.dot(direction);
            sum += cos.max(0.0);
            count += u32::from(cos > 0.0);
        }
        let all = self.0.len() as f32;
        ((sum / all).max(LEAST_MIXTURE), count.max(1) as f32 / all)
    }
}

impl Drawn {
    /// So many directions over the hemisphere and towards what shines, of which nothing else is known any more.
    pub fn of(hemisphere: u32, areas: u32) -> Self {
        Self { hemisphere, areas, ..Self::default() }
    }

    /// Samples of both strategies.
    pub fn samples(&self) -> u32 {
        self.hemisphere + self.areas
    }

    /// Counts `samples` more that are drawn as `view` says.
    pub fn expect(&mut self, view: &View, samples: u32) {
        self.areas += samples;
        self.views.reserve_exact(1);
        self.views.push((view.recipe, samples));
    }

    /// The form factor of one sample along `direction`, of which area sampling knows `known`.
    fn form_factor(&self, sight: &Sight, direction: Vec3, known: Found) -> f32 {
        let (cos, facing) = self.normals.facing(direction);
        let mut expected = self.hemisphere as f32 * cos * FRAC_1_PI;
        if let Some(samples) = sight.expected.get(known.cluster as usize) {
            expected += samples * known.pdf * facing;
        }
        FRAC_1_PI * cos / expected
    }

    /// The form factor of `link`.
    pub fn weigh(&self, sight: &Sight, link: &Link) -> f32 {
        let (patch, back) = link.target();
        let cluster = sight.guide.filter(|_| !back).map_or(NO_CLUSTER, |guide| guide.cluster(patch));
        self.form_factor(sight, link.direction(), Found { cluster, pdf: link.pdf_area })
    }

    /// The same of a link to the sky.
    pub fn weigh_sky(&self, sight: &Sight, link: &SkyLink) -> f32 {
        self.form_factor(sight, link.direction(), link.known)
    }

    /// The mean cosine over the block of a link along `direction`, and the solid angle [sr] that it stands for where its form factor is
    /// `weight`.
    pub fn solid_angle(&self, direction: Vec3, weight: f32) -> (f32, f32) {
        let cos = self.normals.facing(direction).0;
        (cos, PI * weight / cos)
    }
}

/// What shines as a block has looked at it; nothing before anything is known to shine.
#[derive(Default)]
pub struct Sight<'a> {
    guide: Option<&'a Guide>,
    /// Area samples that are expected of each cluster.
    pub expected: Vec<f32>,
}

impl<'a> Sight<'a> {
    /// As `drawn` says of a block to which `arriving` [lx] comes from each cluster of `guide`.
    pub fn new(guide: &'a Guide, drawn: &Drawn, mut arriving: Vec<f32>) -> Self {
        guide.expected(&drawn.views, &mut arriving);
        Self { guide: Some(guide), expected: arriving }
    }
}
