//! Metropolis light transport: chains of samples, each a small change of the one before, that dwell where light is (Veach, Guibas 1997).
//!
//! A sample is what [`Bidirectional`] makes of a vector of numbers in [0, 1); chains change the numbers (Kelemen et al. 2002, "A Simple and
//! Robust Mutation Strategy for the Metropolis Light Transport Algorithm"): all of them anew by a *large step*, or each by a little; or one
//! walk's anew, with the other's kept, so that a light's walk that found the gap of a door is seen from everywhere. What is
//! proposed is taken with the probability of its brightness over that of what is there, and both are recorded with what they
//! expect. Chains know brightness up to a factor, which is the mean over all samples that know nothing of chains: those at the start,
//! and large steps.
//!
//! Passes go on where the last one ended, so they tell no error; groups of chains do, which share nothing.

use super::Integrator;
use super::bidirectional::{Added, Bidirectional, Shares, Streams};
use crate::Result;
use crate::color::{Rgb, luminance};
use crate::progress::Progress;
use crate::sample::{Discrete, Numbers, Random};
use crate::sensor::Film;
use glam::DVec3;
use rayon::prelude::*;

/// Chains, and groups of them.
const CHAINS: usize = 64;
pub const GROUPS: usize = 8;

/// Samples of each chain that the first of its states is drawn from.
const FIRST: u32 = 512;

/// Mutations that a chain makes before what it recorded is added up.
const AT_ONCE: usize = 256;

/// Shares of the mutations: everything anew; the eye's walk anew; the light's walk anew. The rest are small steps.
const ANEW: f32 = 0.15;
const EYE_ANEW: f32 = 0.35;
const LIGHT_ANEW: f32 = 0.1;

/// What light's walks find by themselves stays in its pixel however the eye's walk changes, so it is left to the eye where it can be.
const LIGHT_ALONE: f32 = 0.1;

/// Standard deviation of a small step.
const SMALL: f32 = 0.01;

/// Light by chains of bidirectional samples.
pub struct Metropolis<'a> {
    paths: Bidirectional<'a>,
    choice: Choice,
    chains: Vec<Chain>,
    groups: Vec<Group>,
    passes: u64,
}

/// How pixels are chosen by two numbers.
enum Choice {
    /// Of a picture: its width and height.
    Picture([u32; 2]),
    /// By area, so that every square metre gets as much attention.
    Areas(Discrete),
    /// Nothing measures.
    None,
}

/// What a group of chains has found.
struct Group {
    /// Values over brightness, added up.
    sums: Vec<DVec3>,
    mutations: u64,
    /// Brightness of independent samples, added up, and their number.
    brightness: f64,
    samples: u64,
}

/// A chain at one of its states.
struct Chain {
    numbers: Streams<Stream>,
    pixel: Stream,
    random: Random,
    /// `None` where no light was found to start from.
    state: Option<State>,
}

/// How the numbers of a stream change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Change {
    Anew,
    Small,
    None,
}

/// A sample, and how much it is to be recorded yet.
struct State {
    added: Vec<Added>,
    brightness: f64,
    weight: f64,
}

/// What a run of mutations recorded.
#[derive(Default)]
struct Record {
    added: Vec<Added>,
    brightness: f64,
    samples: u64,
}

impl<'a> Metropolis<'a> {
    /// Chains of samples of `paths`: pixels of a picture are chosen evenly, those on surfaces by area.
    pub fn new(mut paths: Bidirectional<'a>) -> Self {
        let sensor = paths.sensor;
        let choice = match sensor.size() {
            Some(size) => Choice::Picture(size),
            None => {
                let areas = Discrete::new((0..sensor.len()).map(|pixel| f64::from(sensor.area(pixel))));
                paths.shares = Shares::ByArea(areas.as_ref().map_or(1.0, Discrete::total) as f32);
                areas.map_or(Choice::None, Choice::Areas)
            }
        };
        paths.light_alone = LIGHT_ALONE;
        Self { paths, choice, chains: Vec::new(), groups: Vec::new(), passes: 0 }
    }

    /// The first states, in proportion to their brightness.
    fn start(&mut self, progress: &dyn Progress) -> Result<()> {
        let chances: Vec<Vec<f64>> = (0..CHAINS)
            .into_par_iter()
            .map(|chain| {
                progress.check()?;
                let mut added = Vec::new();
                let brightness = |k| self.evaluate(&mut self.fresh(chain, k), &mut added);
                Ok((0..FIRST).map(brightness).collect())
            })
            .collect::<Result<_>>()?;
        let (mut groups, mut chains) = (Vec::new(), Vec::new());
        for (group, chances) in chances.chunks(CHAINS / GROUPS).enumerate() {
            let all = || chances.iter().flatten().copied();
            groups.push(Group {
                sums: vec![DVec3::ZERO; self.paths.sensor.len()],
                mutations: 0,
                brightness: all().sum(),
                samples: all().count() as u64,
            });
            let choice = Discrete::new(all());
            for k in 0..chances.len() {
                let first = group * chances.len();
                let mut random = self.random(first + k, FIRST, 0);
                let (chosen, _) = choice.as_ref().map_or((0, 0.0), |choice| choice.sample(random.next()));
                let mut chain = self.fresh(first + chosen / FIRST as usize, chosen as u32 % FIRST);
                let mut added = Vec::new();
                let brightness = self.evaluate(&mut chain, &mut added);
                chain.accept();
                // Two chains may start at one state, and are to part.
                chain.reseed(|stream| self.random(first + k, FIRST, stream + 1));
                chain.random = random;
                chain.state = (brightness > 0.0).then_some(State { added, brightness, weight: 0.0 });
                chains.push(chain);
            }
        }
        (self.groups, self.chains) = (groups, chains);
        Ok(())
    }

    fn random(&self, chain: usize, sample: u32, stream: u64) -> Random {
        Random::new(self.paths.seed, (chain as u64) << 40 | u64::from(sample) << 8 | stream)
    }

    /// A chain that is about to make sample `sample` of those that are independent.
    fn fresh(&self, chain: usize, sample: u32) -> Chain {
        let stream = |k| Stream::new(self.random(chain, sample, k));
        let numbers = Streams { eye: stream(1), light: stream(2), joins: stream(3) };
        let mut chain = Chain { numbers, pixel: stream(4), random: self.random(chain, sample, 5), state: None };
        chain.propose(Change::Anew, Change::Anew);
        chain
    }

    /// What the numbers that `chain` proposes make, and how bright it is.
    fn evaluate(&self, chain: &mut Chain, added: &mut Vec<Added>) -> f64 {
        added.clear();
        let u = chain.pixel.pair();
        let pixel = match &self.choice {
            Choice::Picture([width, height]) => {
                let [x, y] = [(u[0], width), (u[1], height)].map(|(u, n)| ((u * *n as f32) as u32).min(n - 1));
                (y * width + x) as usize
            }
            Choice::Areas(areas) => areas.sample(u[0]).0,
            Choice::None => return 0.0,
        };
        self.paths.sample(pixel, &mut chain.numbers, added);
        let bright = |(pixel, value): &Added| f64::from(luminance(*value)) * f64::from(self.paths.sensor.area(*pixel));
        let brightness = added.iter().map(bright).sum::<f64>();
        if brightness.is_finite() { brightness } else { 0.0 }
    }

    /// Makes so many mutations of `chain`.
    fn run(&self, chain: &mut Chain, mutations: usize) -> Record {
        let mut record = Record::default();
        let Some(mut state) = chain.state.take() else { return record };
        let mut added = Vec::new();
        for _ in 0..mutations {
            let (eye, light) = mutation(chain.random.next());
            chain.propose(eye, light);
            let brightness = self.evaluate(chain, &mut added);
            if (eye, light) == (Change::Anew, Change::Anew) {
                record.brightness += brightness;
                record.samples += 1;
            }
            let accepted = (brightness / state.brightness).min(1.0);
            state.weight += 1.0 - accepted;
            if f64::from(chain.random.next()) < accepted {
                record.take(&mut state);
                state = State { added: std::mem::take(&mut added), brightness, weight: accepted };
                chain.accept();
            } else {
                if accepted > 0.0 {
                    record.take(&mut State { added: std::mem::take(&mut added), brightness, weight: accepted });
                }
                chain.reject();
            }
        }
        record.take(&mut state);
        chain.state = Some(state);
        record
    }

    /// What each group makes of every pixel.
    fn estimates(&self) -> Vec<Vec<Rgb>> {
        let estimate = |group: &Group| {
            let mean = group.brightness / group.samples.max(1) as f64;
            let factor = mean / group.mutations.max(1) as f64;
            group.sums.iter().map(|sum| (*sum * factor).as_vec3()).collect()
        };
        self.groups.iter().map(estimate).collect()
    }
}

impl Integrator for Metropolis<'_> {
    fn pass(&mut self, film: &mut Film, progress: &dyn Progress) -> Result<()> {
        if self.chains.is_empty() {
            self.start(progress)?;
        }
        let mut left = self.paths.sensor.len().div_ceil(CHAINS);
        while left > 0 {
            progress.check()?;
            let count = left.min(AT_ONCE);
            left -= count;
            progress.advance((count * CHAINS) as u64);
            let mut chains = std::mem::take(&mut self.chains);
            let records: Vec<Record> = chains.par_iter_mut().map(|chain| self.run(chain, count)).collect();
            self.chains = chains;
            for (k, record) in records.into_iter().enumerate() {
                let group = &mut self.groups[k / (CHAINS / GROUPS)];
                group.mutations += count as u64;
                group.brightness += record.brightness;
                group.samples += record.samples;
                record.added.into_iter().for_each(|(pixel, value)| group.sums[pixel] += value.as_dvec3());
            }
        }
        self.passes += 1;
        film.replace(&self.estimates(), self.passes);
        Ok(())
    }
}

impl Record {
    /// Records what `state` is still to count with.
    fn take(&mut self, state: &mut State) {
        let factor = (std::mem::take(&mut state.weight) / state.brightness) as f32;
        if factor > 0.0 {
            self.added.extend(state.added.iter().map(|(pixel, value)| (*pixel, *value * factor)));
        }
    }
}

impl Chain {
    fn streams(&mut self) -> [&mut Stream; 4] {
        [&mut self.pixel, &mut self.numbers.eye, &mut self.numbers.light, &mut self.numbers.joins]
    }

    /// Changes the numbers of the pixel and the walk from it, and of the light's walk.
    fn propose(&mut self, eye: Change, light: Change) {
        [&mut self.pixel, &mut self.numbers.eye, &mut self.numbers.joins].into_iter().for_each(|s| s.propose(eye));
        self.numbers.light.propose(light);
    }

    fn accept(&mut self) {
        self.streams().into_iter().for_each(Stream::accept);
    }

    fn reject(&mut self) {
        self.streams().into_iter().for_each(Stream::reject);
    }

    fn reseed(&mut self, random: impl Fn(u64) -> Random) {
        for (k, stream) in self.streams().into_iter().enumerate() {
            stream.random = random(k as u64);
        }
    }
}

/// The mutation that `u` picks: of what the eye's walk is made of, and of what the light's is.
fn mutation(u: f32) -> (Change, Change) {
    if u < ANEW {
        (Change::Anew, Change::Anew)
    } else if u < ANEW + EYE_ANEW {
        (Change::Anew, Change::None)
    } else if u < ANEW + EYE_ANEW + LIGHT_ANEW {
        (Change::None, Change::Anew)
    } else {
        (Change::Small, Change::Small)
    }
}

/// Numbers of a chain's state, changed only once they are asked for.
struct Stream {
    numbers: Vec<Number>,
    /// The next one.
    at: usize,
    random: Random,
    /// Proposals that were accepted, and how many of them there were at the last large step.
    step: u64,
    last_large: u64,
    change: Change,
    /// What the numbers that were asked for were before.
    before: Vec<Number>,
}

/// A number, and the step that it is up to.
#[derive(Clone, Copy)]
struct Number {
    value: f32,
    step: u64,
}

impl Stream {
    fn new(random: Random) -> Self {
        Self { numbers: Vec::new(), at: 0, random, step: 0, last_large: 0, change: Change::Anew, before: Vec::new() }
    }

    fn propose(&mut self, change: Change) {
        (self.at, self.change) = (0, change);
        self.before.clear();
    }

    fn accept(&mut self) {
        self.step += u64::from(self.change != Change::None);
        if self.change == Change::Anew {
            self.last_large = self.step;
        }
        self.before.clear();
    }

    fn reject(&mut self) {
        self.numbers[..self.before.len()].copy_from_slice(&self.before);
        self.before.clear();
    }
}

impl Numbers for Stream {
    fn next(&mut self) -> f32 {
        if self.at == self.numbers.len() {
            let value = self.random.next();
            self.numbers.push(Number { value, step: self.last_large });
        }
        let number = &mut self.numbers[self.at];
        if number.step < self.last_large {
            *number = Number { value: self.random.next(), step: self.last_large };
        }
        self.before.push(*number);
        let next = self.step + u64::from(self.change != Change::None);
        if self.change == Change::Anew {
            number.value = self.random.next();
        } else if next > number.step {
            // Steps that were missed add up to a wider one.
            let width = SMALL * ((next - number.step) as f32).sqrt();
            let moved = number.value + width * normal(&mut self.random);
            let wrapped = moved - moved.floor();
            number.value = if wrapped < 1.0 { wrapped } else { 0.0 };
        }
        number.step = next;
        self.at += 1;
        self.numbers[self.at - 1].value
    }
}

/// A number of the standard normal distribution (Box, Muller 1958).
fn normal(random: &mut Random) -> f32 {
    let [u, v] = random.pair();
    (-2.0 * (1.0 - u).ln()).sqrt() * (std::f32::consts::TAU * v).cos()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stay_even_and_rejected_ones_come_back() {
        let mut stream = Stream::new(Random::new(1, 2));
        let mut counts = [0u32; 10];
        for step in 0..60_000 {
            stream.propose([Change::Anew, Change::Small, Change::None][step % 7 % 3]);
            // Every other state asks for more of them.
            let asked: Vec<f32> = (0..3 + step % 2 * 2).map(|_| stream.next()).collect();
            if step % 3 == 0 {
                stream.accept();
                counts[(asked[2] * 10.0) as usize] += 1;
            } else {
                let kept: Vec<f32> = stream.before.iter().map(|n| n.value).collect();
                stream.reject();
                assert!(stream.numbers.iter().zip(&kept).all(|(n, k)| n.value == *k));
            }
        }
        assert!(counts.iter().all(|n| n.abs_diff(2000) < 300), "{counts:?}");
    }

    #[test]
    fn small_steps_are_as_wide_as_they_are_many() {
        let mut stream = Stream::new(Random::new(3, 4));
        stream.propose(Change::Anew);
        let first: Vec<f32> = (0..4000).map(|_| stream.next()).collect();
        stream.accept();
        for _ in 0..8 {
            stream.propose(Change::Small);
            stream.accept();
        }
        stream.propose(Change::Small);
        let squares = first.iter().map(|from| {
            let d = (stream.next() - from).abs();
            f64::from(d.min(1.0 - d)).powi(2)
        });
        let width = (squares.sum::<f64>() / first.len() as f64).sqrt();
        assert!((width / (3.0 * f64::from(SMALL)) - 1.0).abs() < 0.05, "{width}");
    }
}
