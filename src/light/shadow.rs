//! The visible share of emitters: a glance at all, and a close look where shadows may be.
//!
//! What arrives without occluders is known; the visible share of it is estimated as a ratio of two sums over the same samples
//! (Heitz, Hill, McGuire 2018, "Combining analytic direct illumination and stochastic shadows"), so that a receiver without
//! shadows has no noise at all.
//!
//! A close look takes as many samples as its share calls for: the standard deviation of a visible share p is sqrt(p (1 - p))
//! for one sample, and falls with n^-3/4, as stratified samples of an area that an edge parts (Mitchell 1996, "Consequences
//! of stratified sampling in graphics").

use super::emitter::{Emitter, Shot, Sight, Way};
use super::receiver::{Arriving, Site};
use crate::color::Rgb;
use crate::scene::material::mean_share;
use crate::trace::{Ray, Segment, Tracer};
use std::ops::Range;

/// What some receivers saw of emitters, by their bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Ballot {
    pub seen: u32,
    pub blocked: u32,
}

impl Ballot {
    /// What either saw.
    pub fn or(self, other: Self) -> Self {
        Self { seen: self.seen | other.seen, blocked: self.blocked | other.blocked }
    }

    /// Emitters of `own` about which all that was seen disagrees.
    pub fn disputed(self, own: Self) -> u32 {
        self.seen & self.blocked & (own.seen | own.blocked)
    }
}

/// How closely emitters are looked at.
#[derive(Clone, Copy, Debug)]
pub(super) struct Look {
    /// Bits of the emitters that get more than a glance.
    pub closely: u32,
    /// Mean luminance of the light around [lx]: what errors are relative to, see [`IN_THE_DARK`].
    pub around: f32,
    /// Standard error of the light from each, relative to the light around.
    pub error: f32,
    /// Samples of each, at most.
    pub most_samples: u32,
    /// Samples are whole powers of two, whose points are spread most evenly: for what is seen as it is.
    pub evenly: bool,
}

/// Errors are relative to this share of all that would arrive unoccluded where that is more than what does arrive: deep in a
/// shadow other light shows more than the last of this one.
const IN_THE_DARK: f32 = 0.25;

/// Samples of a close look at first.
const CLOSE_SAMPLES: u32 = 8;

/// Shadow rays that are traced together: all to one emitter.
#[derive(Default)]
pub(super) struct Volley {
    shots: Vec<Shot>,
    segments: Vec<Segment>,
    rays: Vec<Ray>,
    /// What gets through of each, by channel.
    passing: Vec<Rgb>,
    /// Some are blocked by some surfaces alone.
    is_linked: bool,
}

impl Volley {
    fn push(&mut self, shot: Shot) {
        match shot.way {
            Way::To(segment) => self.segments.push(segment),
            Way::Along(ray) => self.rays.push(ray),
        }
        self.is_linked |= shot.shade.is_some();
        self.shots.push(shot);
    }

    fn clear(&mut self) {
        self.shots.clear();
        self.segments.clear();
        self.rays.clear();
        self.is_linked = false;
    }

    fn fire(&mut self, sight: &Sight) {
        self.passing.clear();
        self.passing.resize(self.shots.len(), Rgb::ZERO);
        if self.is_linked || !(self.segments.is_empty() || self.rays.is_empty()) {
            // A cluster may hold portals beside lamps, and lamps that are linked beside others.
            for (shot, passing) in self.shots.iter().zip(&mut self.passing) {
                *passing = passing_of(shot, sight.lights.tracer(sight.tracer, shot.shade));
            }
        } else if self.rays.is_empty() {
            sight.tracer.transmittance(&self.segments, &mut self.passing);
        } else {
            sight.tracer.transmittance_of_rays(&self.rays, &mut self.passing);
        }
    }
}

/// What gets through of a shot past all that `tracer` knows; without one nothing is in its way.
fn passing_of(shot: &Shot, tracer: Option<&Tracer>) -> Rgb {
    let mut passing = [Rgb::ONE];
    match (tracer, shot.way) {
        (None, _) => {}
        (Some(tracer), Way::To(segment)) => tracer.transmittance(&[segment], &mut passing),
        (Some(tracer), Way::Along(ray)) => tracer.transmittance_of_rays(&[ray], &mut passing),
    }
    passing[0]
}

/// Sums over the samples of one emitter at one receiver.
#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    tried: [f32; 2],
    seen: [Rgb; 2],
    other: Rgb,
    /// Samples, and those that reached out for the emitter.
    count: u32,
    facing: u32,
    /// Shares that got through to it, and their squares, added up.
    visible: f32,
    squares: f32,
    /// The least and the most of what got through but for nothing and all.
    dimmed: Option<[f32; 2]>,
    levels: Levels,
}

/// Which kinds of shares got through.
#[derive(Clone, Copy, Debug, Default)]
struct Levels {
    seen: bool,
    blocked: bool,
}

/// Steps in which shares of light are told apart.
const STEPS: f32 = 16.0;

impl Levels {
    /// Nothing and all are told apart for sure, and what lies between from both and from itself every other time: edges between panes
    /// are long.
    fn add(&mut self, passing: Rgb) {
        let [r, g, b] = (passing * STEPS).round().to_array().map(|step| step as u32);
        let is_seen = match passing {
            Rgb::ONE => true,
            Rgb::ZERO => false,
            _ => (r ^ (g << 1) ^ (b << 2)).count_ones() % 2 == 1,
        };
        self.seen |= is_seen;
        self.blocked |= !is_seen;
    }
}

impl Tally {
    fn add(&mut self, shot: &Shot, passing: Rgb) {
        let share = mean_share(passing);
        self.facing += 1;
        self.visible += share;
        self.squares += share * share;
        self.levels.add(passing);
        if share > 0.0 && share < 1.0 {
            let [least, most] = self.dimmed.unwrap_or([share; 2]);
            self.dimmed = Some([least.min(share), most.max(share)]);
        }
        for k in 0..2 {
            self.tried[k] += shot.kernel[k];
            self.seen[k] += shot.light[k] * passing;
        }
        if shot.is_light {
            self.other += shot.light[0] * passing;
        }
    }

    fn ballot(&self, bit: u32) -> Ballot {
        let only = |is: bool| if is { bit } else { 0 };
        let is_uneven = self.dimmed.is_some_and(|[least, most]| most - least > STEPS.recip());
        Ballot { seen: only(self.levels.seen || is_uneven), blocked: only(self.levels.blocked || is_uneven) }
    }

    /// Adds the light of an emitter of so much `brightness`: the visible share of what is known to arrive unoccluded, or else the mean of the
    /// samples.
    fn arrive(&self, unoccluded: Option<[f32; 2]>, brightness: f32, sum: &mut Arriving) {
        let scale = |k: usize| match unoccluded {
            Some(whole) if self.tried[k] > 0.0 => whole[k] / self.tried[k],
            Some(_) => 0.0,
            None => 1.0 / self.count.max(1) as f32,
        };
        sum.transport += self.seen[0] * scale(0);
        sum.shown += self.seen[1] * scale(1);
        sum.other += self.other * scale(0);
        sum.rays += u64::from(self.facing);
        sum.whole += unoccluded.map_or(f32::INFINITY, |whole| whole[0] * brightness);
    }

    /// Samples that bring the standard error down to the share `error` of the light `around`, or of the emitter's own where that
    /// is more; unoccluded it would bring `light`.
    fn wanted(&self, light: f32, around: f32, error: f32) -> f32 {
        if light <= 0.0 {
            return 0.0;
        }
        let p = self.share();
        (self.spread().sqrt() * light / (error * around.max(p * light))).powf(4.0 / 3.0)
    }

    /// The variance of the light from an emitter that would bring `light` unoccluded.
    fn variance(&self, light: f32) -> f32 {
        self.spread() * light * light * (self.facing.max(1) as f32).powf(-1.5)
    }

    /// The visible share, as if one more sample had seen the emitter and one more had not: a share of the first samples is never sure.
    fn share(&self) -> f32 {
        (self.visible + 1.0) / (self.facing + 2) as f32
    }

    /// The variance of the share that one sample finds: p (1 - p) where it is all or nothing.
    fn spread(&self) -> f32 {
        let p = self.share();
        (p * (1.0 - p) - (self.visible - self.squares) / (self.facing + 2) as f32).max(0.0)
    }
}

/// Samples of which the first that reaches out for an emitter is taken where those asked for don't: at the edge of a cone, or
/// where an emitter is partly below the horizon.
const TRIES: u32 = 16;

/// Takes some samples of one emitter at one receiver.
fn aim(sight: &Sight, emitter: Emitter, site: &Site, set: u32, samples: Range<u32>, volley: &mut Volley) {
    let before = volley.shots.len();
    // The mean over a cluster is over all samples, whichever reach out.
    let tries = if matches!(emitter, Emitter::Cluster(..)) { samples.end } else { samples.end.max(TRIES) };
    for index in samples.start..tries {
        if index >= samples.end && volley.shots.len() > before {
            break;
        }
        let (point, u) = site.draw(index, set, sight.params.unit);
        if let Some(shot) = emitter.shot(sight, &point, u) {
            volley.push(shot);
        }
    }
}

/// A glance at every emitter from every site: what arrives, and what was seen.
pub(super) fn glance(
    sight: &Sight,
    emitters: &[Emitter],
    sites: &[&Site],
    volley: &mut Volley,
) -> Vec<(Arriving, Ballot)> {
    let mut all = vec![(Arriving::default(), Ballot::default()); sites.len()];
    let mut ends = Vec::with_capacity(sites.len());
    for &emitter in emitters {
        volley.clear();
        ends.clear();
        let (set, count) = first_samples(sight, emitter);
        for (k, site) in sites.iter().enumerate() {
            let unoccluded = emitter.unoccluded(sight, site);
            if unoccluded != Some([0.0; 2]) {
                aim(sight, emitter, site, set, 0..count, volley);
                ends.push((k, unoccluded, volley.shots.len()));
            }
        }
        volley.fire(sight);
        let mut start = 0;
        for &(k, unoccluded, end) in &ends {
            let mut tally = Tally { count, ..Tally::default() };
            for (shot, passing) in volley.shots[start..end].iter().zip(&volley.passing[start..end]) {
                tally.add(shot, *passing);
            }
            start = end;
            let (sum, ballot) = &mut all[k];
            tally.arrive(unoccluded, emitter.brightness(sight), sum);
            *ballot = ballot.or(tally.ballot(emitter.bit()));
        }
    }
    all
}

fn first_samples(sight: &Sight, emitter: Emitter) -> (u32, u32) {
    match emitter {
        Emitter::Cluster(_, samples) => (emitter.set(), samples),
        _ if emitter.is_varied(sight) => (emitter.set(), sight.params.cluster_samples),
        // The points of the first set are those that the unoccluded light is averaged over: colours agree with it.
        _ if emitter.is_colorful(sight) => (0, sight.params.cluster_samples),
        _ => (0, sight.params.first_samples),
    }
}

/// What a close look found.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Examined {
    pub arriving: Arriving,
    pub ballot: Ballot,
    /// Of what arrives [lx^2] (luminance), as far as it is known.
    pub variance: f32,
}

impl Examined {
    /// Puts it in the place of what was found before, with the rays that took.
    pub fn replace(self, arriving: &mut Arriving, variance: &mut f32) {
        *arriving = Arriving { rays: arriving.rays + self.arriving.rays, ..self.arriving };
        *variance = self.variance;
    }
}

/// As a glance at one site, but for emitters that are looked at closely.
pub(super) fn examine(sight: &Sight, emitters: &[Emitter], site: &Site, look: Look, volley: &mut Volley) -> Examined {
    let mut found = Examined::default();
    let unoccluded: Vec<Option<[f32; 2]>> = emitters.iter().map(|e| e.unoccluded(sight, site)).collect();
    let light =
        |emitter: Emitter, whole: Option<[f32; 2]>| whole.map_or(0.0, |w| w[0].max(w[1]) * emitter.brightness(sight));
    let total: f32 = emitters.iter().zip(&unoccluded).map(|(e, w)| light(*e, *w)).sum();
    let around = look.around.max(IN_THE_DARK * total);
    for (&emitter, &unoccluded) in emitters.iter().zip(&unoccluded) {
        if unoccluded == Some([0.0; 2]) {
            continue;
        }
        let light = light(emitter, unoccluded);
        let is_close = look.closely & emitter.bit() != 0;
        let (first_set, first) = first_samples(sight, emitter);
        let (set, mut count) = match is_close {
            true if emitter.is_colorful(sight) => (first_set, first.max(CLOSE_SAMPLES)),
            true => (emitter.set(), CLOSE_SAMPLES),
            false => (first_set, first),
        };
        let mut tally = Tally::default();
        while count > tally.count {
            volley.clear();
            aim(sight, emitter, site, set, tally.count..count, volley);
            volley.fire(sight);
            for (shot, passing) in volley.shots.iter().zip(&volley.passing) {
                tally.add(shot, *passing);
            }
            tally.count = count;
            if is_close {
                let wanted = tally.wanted(light, around, look.error).min(look.most_samples as f32).ceil() as u32;
                let rounded =
                    if look.evenly { wanted.next_power_of_two() } else { wanted.next_multiple_of(CLOSE_SAMPLES) };
                count = rounded.min(look.most_samples);
            }
        }
        tally.arrive(unoccluded, emitter.brightness(sight), &mut found.arriving);
        found.ballot = found.ballot.or(tally.ballot(emitter.bit()));
        if is_close {
            found.variance += tally.variance(light);
        }
    }
    found
}
