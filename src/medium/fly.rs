//! How far a way goes before media turn it: distances drawn per channel in closed form, and by delta tracking through grids.
//!
//! A ray is cut into *stretches* over which it has the same media around it, and the same bounds on grids. Without grids, a channel is
//! drawn by its share of the throughput and a distance by its coefficient, and the weight is that of the mixture over channels. With
//! grids, collisions come at a rate that is at least that of any channel; each is real with the mean probability over channels, by
//! their shares at that moment (Kutz, Habel, Li, Novak 2017, "Spectral and decomposition tracking").
//!
//! What media emit is added up along the way: in closed form without grids, with them at every collision, real or not, as emission
//! over rate (the collision estimator: Raab, Seibert, Keller 2008).

use super::body::Crossing;
use super::transmittance::{attenuation, free_path};
use super::{Media, Phase};
use crate::color::Rgb;
use crate::sample::Numbers;
use crate::trace::Ray;

/// How a way through media ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Flight {
    /// It came as far as was asked.
    Passed {
        /// What its throughput is multiplied by.
        weight: Rgb,
        /// Radiance that media sent into it on the way [nit], to be weighed by the throughput that it began with.
        emitted: Rgb,
    },
    /// It was scattered.
    Scattered {
        /// Distance [m].
        t: f32,
        /// What its throughput is multiplied by, albedo included, phase function left out.
        weight: Rgb,
        /// As in [`Flight::Passed`].
        emitted: Rgb,
        /// How it goes on.
        phase: Phase,
    },
}

impl Flight {
    /// What its throughput is multiplied by.
    pub fn weight(&self) -> Rgb {
        let (Self::Passed { weight, .. } | Self::Scattered { weight, .. }) = self;
        *weight
    }

    /// Radiance that media sent into it on the way [nit], to be weighed by the throughput that it began with.
    pub fn emitted(&self) -> Rgb {
        let (Self::Passed { emitted, .. } | Self::Scattered { emitted, .. }) = self;
        *emitted
    }
}

/// Collisions along a way through a grid that emits, on average at least.
const EMISSION_STEPS: f64 = 8.0;

/// Throughput of a channel over the largest one, below which it isn't followed: it would be drawn once in so many ways.
const LEAST_SHARE: f32 = 1e-9;

/// The state of a way.
struct Way {
    /// What it was when it began: shares of channels follow it.
    throughput: Rgb,
    weight: Rgb,
    emitted: Rgb,
    /// Mean free paths to the next collision, where they are known.
    rest: Option<f64>,
}

/// What is the same over a stretch of the way.
struct Stretch<'a, 'b> {
    /// Those with a bound of 0 are not around it.
    crossings: &'b [Crossing<'a>],
    /// Of the homogeneous media around it.
    homogeneous: Sum,
    /// Bound on what grids take and turn [1/m].
    bound: f64,
    /// Least rate of collisions, for what is emitted [1/m].
    least: f64,
    has_grid: bool,
}

/// Coefficients added up [1/m], [nit/m].
#[derive(Clone, Copy, Default)]
struct Sum {
    met: Rgb,
    absorbed: Rgb,
    emission: Rgb,
}

impl Sum {
    fn add(&mut self, crossing: &Crossing, density: f32) {
        self.met += crossing.body.met * density;
        self.absorbed += crossing.body.absorbed * density;
        self.emission += crossing.body.emission * density;
    }
}

impl Media {
    /// Follows `ray` for `distance` [m], which may be infinite, with the `throughput` that the way has so far: channels are drawn by
    /// it, and its sum over channels never grows. Channels without any have weights of 0; a throughput of 0 is followed as an even one.
    ///
    /// In the mean, the weights of those that pass are the transmittance, and those that are scattered between t and t + dt weigh
    /// `T(t) sigma_s(t) dt`. Nothing is drawn where no medium that scatters, and no grid, lies in the way.
    pub fn fly(&self, ray: &Ray, distance: f32, throughput: Rgb, numbers: &mut impl Numbers) -> Flight {
        let mut crossings: Vec<Crossing> = self.bodies.iter().filter_map(|body| body.cross(ray, distance)).collect();
        let mut way = Way::new(throughput);
        let mut t = crossings.iter().map(|c| c.span[0]).fold(f64::INFINITY, f64::min);
        while let Some(end) = next_border(&mut crossings, t) {
            let stretch = Stretch::new(&crossings);
            let turned = match stretch.has_grid {
                true => way.track(&stretch, [t, end], numbers),
                false => way.follow(&stretch, [t, end], numbers),
            };
            if let Some((at, phase)) = turned {
                return Flight::Scattered { t: at as f32, weight: way.weight, emitted: way.emitted, phase };
            }
            if way.weight == Rgb::ZERO {
                break;
            }
            t = end;
        }
        Flight::Passed { weight: way.weight, emitted: way.emitted }
    }
}

/// Where the stretch that begins at `t` ends, and with it the bounds of all crossings; `None` where no medium lies ahead.
fn next_border(crossings: &mut [Crossing], t: f64) -> Option<f64> {
    let mut end = f64::INFINITY;
    for crossing in crossings {
        let [enter, leave] = crossing.span;
        crossing.bound = 0.0;
        if t < enter {
            end = end.min(enter);
        } else if t < leave {
            let (bound, border) = crossing.walk.as_mut().map_or((1.0, leave), |walk| walk.bound(t));
            crossing.bound = bound;
            end = end.min(leave).min(border);
        }
    }
    end.is_finite().then_some(end)
}

impl<'a, 'b> Stretch<'a, 'b> {
    fn new(crossings: &'b [Crossing<'a>]) -> Self {
        let mut stretch = Self { crossings, homogeneous: Sum::default(), bound: 0.0, least: 0.0, has_grid: false };
        for crossing in stretch.around() {
            if crossing.body.grid.is_none() {
                stretch.homogeneous.add(crossing, 1.0);
            } else {
                stretch.has_grid = true;
                stretch.bound += f64::from(crossing.bound) * f64::from(crossing.body.extinction().max_element());
            }
            if crossing.body.emission != Rgb::ZERO {
                let [enter, leave] = crossing.span;
                stretch.least = stretch.least.max(EMISSION_STEPS / (leave - enter));
            }
        }
        stretch
    }

    /// The crossings whose media are around it.
    fn around(&self) -> impl Iterator<Item = &'b Crossing<'a>> + use<'a, 'b> {
        self.crossings.iter().filter(|c| c.bound > 0.0)
    }

    /// Rate of collisions [1/m] that no channel exceeds in which a way of this `weight` carries anything.
    fn rate(&self, weight: Rgb) -> f64 {
        let steady = self.homogeneous.met;
        let strongest = (0..3).filter(|&c| weight[c] > 0.0).map(|c| steady[c]).fold(0.0, f32::max);
        (f64::from(strongest) + self.bound).max(self.least)
    }

    /// The medium around `t` that turns the way, drawn by what each scatters of `shares`, and what the weight is multiplied by [1/m].
    fn turn(&self, t: f64, shares: Rgb, u: f32) -> (Phase, Rgb) {
        let scattering = |c: &Crossing| c.body.scattering * c.density(t);
        let total: f32 = self.around().map(|c| scattering(c).dot(shares)).sum();
        let mut rest = u * total;
        let mut drawn = (Phase::ISOTROPIC, Rgb::ZERO);
        for crossing in self.around() {
            let own = scattering(crossing);
            let chance = own.dot(shares);
            if chance > 0.0 {
                drawn = (crossing.body.phase, own * (total / chance));
                rest -= chance;
                if rest < 0.0 {
                    break;
                }
            }
        }
        drawn
    }
}

impl Way {
    /// A way that carries nothing in channels whose throughput is nothing beside the others': their weights could be anything.
    fn new(throughput: Rgb) -> Self {
        let most = throughput.max_element();
        let is_dead = |c: f32| most > 0.0 && c < LEAST_SHARE * most;
        let weight = Rgb::from_array(throughput.to_array().map(|c| if is_dead(c) { 0.0 } else { 1.0 }));
        Self { throughput, weight, emitted: Rgb::ZERO, rest: None }
    }

    /// The share of each channel, 1 in all.
    fn shares(&self) -> Rgb {
        let carried = self.throughput * self.weight;
        let sum = carried.element_sum();
        if sum > 0.0 && sum.is_finite() { carried / sum } else { Rgb::splat(1.0 / 3.0) }
    }

    /// Follows a stretch of homogeneous media; where the way was turned, and how.
    fn follow(
        &mut self,
        stretch: &Stretch,
        [start, end]: [f64; 2],
        numbers: &mut impl Numbers,
    ) -> Option<(f64, Phase)> {
        let Sum { met, absorbed, emission } = stretch.homogeneous;
        let length = (end - start) as f32;
        if emission != Rgb::ZERO {
            self.emitted += self.weight * emission * reach(met + absorbed, length);
        }
        if met == Rgb::ZERO {
            self.weight *= attenuation(absorbed * length);
            return None;
        }
        let shares = self.shares();
        let [u, path] = numbers.pair();
        let (channel, u) = pick(shares, u);
        let distance = -(1.0 - path).ln() / met[channel];
        // A channel that nothing meets goes on for ever, also where the number is 0.
        if met[channel] > 0.0 && distance < length {
            let left = attenuation(met * distance);
            let t = start + f64::from(distance);
            let (phase, scattering) = stretch.turn(t, shares * left, u);
            self.weight *= left * attenuation(absorbed * distance) * scattering / shares.dot(met * left);
            Some((t, phase))
        } else {
            let left = attenuation(met * length);
            self.weight *= left * attenuation(absorbed * length) / shares.dot(left);
            None
        }
    }

    /// Follows a stretch with grids; where the way was turned, and how.
    fn track(&mut self, stretch: &Stretch, [start, end]: [f64; 2], numbers: &mut impl Numbers) -> Option<(f64, Phase)> {
        let steady = stretch.homogeneous;
        let mut t = start;
        loop {
            let rate = stretch.rate(self.weight);
            let rest = self.rest.take().unwrap_or_else(|| free_path(numbers));
            let steps = (end - t) * rate;
            let is_over = rest >= steps;
            let next = if is_over { end } else { (t + rest / rate).max(t.next_up()) };
            self.weight *= attenuation(steady.absorbed * (next - t) as f32);
            if is_over {
                self.rest = Some(rest - steps);
                return None;
            }
            t = next;
            let mut here = steady;
            let mut thinned = Rgb::ZERO;
            for crossing in stretch.around().filter(|c| c.body.grid.is_some()) {
                let density = crossing.density(t);
                here.add(crossing, density);
                thinned += crossing.body.absorbed * density;
            }
            self.emitted += self.weight * here.emission / rate as f32;
            let shares = self.shares();
            let met = here.met / rate as f32;
            let chance = shares.dot(met);
            let u = numbers.next();
            if u < chance {
                let (phase, scattering) = stretch.turn(t, shares, u / chance);
                self.weight *= scattering / (rate as f32 * chance);
                return Some((t, phase));
            }
            // What is absorbed alone thins the way; homogeneous media did so in closed form.
            let missed = (1.0 - met - thinned / rate as f32).max(Rgb::ZERO);
            self.weight *= missed / (1.0 - chance);
        }
    }
}

/// The channel that `u` in [0, 1) draws by its share, and `u` rescaled to [0, 1) within it.
fn pick(shares: Rgb, u: f32) -> (usize, f32) {
    let (mut drawn, mut low) = ((0, 0.0), 0.0);
    for channel in (0..3).filter(|&c| shares[c] > 0.0) {
        drawn = (channel, ((u - low) / shares[channel]).clamp(0.0, 1.0 - f32::EPSILON));
        low += shares[channel];
        if u < low {
            break;
        }
    }
    drawn
}

/// The integral of `exp(-sigma t)` over 0..`length` [m], per channel.
fn reach(sigma: Rgb, length: f32) -> Rgb {
    Rgb::from_array(sigma.to_array().map(|sigma| {
        let depth = sigma * length;
        // The difference would cancel.
        if depth < 1e-3 { length * (1.0 - 0.5 * depth + depth * depth / 6.0) } else { -(-depth).exp_m1() / sigma }
    }))
}
