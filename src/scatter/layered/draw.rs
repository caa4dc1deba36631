//! Directions of a layered surface: drawn, with their densities, and those that light is sent on in alone.

use super::{AGAIN, CLEAR, COAT, COAT_IOR, CROSS, Clear, DIFFUSE, Layered, MIRROR, SINGLES, STRATEGIES, Sight};
use crate::color::Rgb;
use crate::sample::warp::{cosine_hemisphere, cosine_hemisphere_pdf};
use crate::scatter::ggx::{mirrored, refracted};
use crate::scatter::{Scattered, Transport, fresnel};
use glam::Vec3;

impl Layered<'_> {
    /// Chances of the strategies; `None` where it sends nothing on.
    fn chances(&self, o: &Sight) -> Option<[f32; STRATEGIES]> {
        let shares = self.shares(o).map(Rgb::element_sum);
        let total: f32 = shares.iter().sum();
        (total > 0.0).then(|| shares.map(|share| share / total))
    }

    /// Density [1/sr] of [`sample`](Self::sample), but for single directions.
    pub fn pdf(&self, o: Vec3, i: Vec3) -> f32 {
        self.chances(&self.sight(o.z, self.inside)).map_or(0.0, |chances| self.mixture(&chances, o, i))
    }

    fn mixture(&self, chances: &[f32; STRATEGIES], o: Vec3, i: Vec3) -> f32 {
        let mut pdf = 0.0;
        if i.z > 0.0 {
            pdf += chances[DIFFUSE] * cosine_hemisphere_pdf(i.z);
            pdf += chances[AGAIN] * self.ggx().bounced_pdf(i.z);
            if chances[MIRROR] + chances[CLEAR] > 0.0 && !self.is_smooth() {
                let clear = match chances[CLEAR] > 0.0 {
                    true => self.mirror_chance(self.clear_fresnel(o.dot((o + i).normalize_or(Vec3::Z)), self.inside)),
                    false => 0.0,
                };
                pdf += (chances[MIRROR] + chances[CLEAR] * clear) * self.ggx().reflect_pdf(o, i);
            }
            if chances[COAT] > 0.0 && !self.is_coat_smooth() {
                pdf += chances[COAT] * self.coat_ggx().reflect_pdf(o, i);
            }
        } else if !self.is_clear_smooth() {
            pdf += chances[CROSS] * self.ggx().bounced_pdf(-i.z);
            if chances[CLEAR] > 0.0 {
                pdf += chances[CLEAR] * self.through_pdf(o, i);
            }
        }
        pdf
    }

    /// Density of directions below, of those that rough clear facets send on.
    fn through_pdf(&self, o: Vec3, i: Vec3) -> f32 {
        let (pdf, cos) = match self.kind {
            Clear::Thin => {
                let i = i.with_z(-i.z);
                (self.ggx().reflect_pdf(o, i), o.dot((o + i).normalize_or(Vec3::Z)))
            }
            Clear::Solid => match self.ggx().refract_pdf(o, i, self.eta()) {
                Some(found) => found,
                None => return 0.0,
            },
        };
        pdf * (1.0 - self.mirror_chance(self.clear_fresnel(cos, self.inside)))
    }

    /// A direction, with what it is worth; `None` where the light ends.
    pub fn sample(&self, o: Vec3, u: [f32; 3], mode: Transport) -> Option<Scattered> {
        let seen = self.sight(o.z, self.inside);
        let chances = self.chances(&seen)?;
        let (strategy, chance, rest) = choose(&chances, u[2]);
        let place = [u[0], u[1]];
        let above = |i: Vec3| (i.z > 0.0).then_some(i);
        let direction = match strategy {
            COAT if self.is_coat_smooth() => {
                let share = self.coat * fresnel::dielectric(o.z, COAT_IOR);
                return Some(Scattered::single(straight_back(o), Rgb::splat(share), chance));
            }
            COAT => above(mirrored(o, self.coat_ggx().sample(o, place)))?,
            MIRROR if self.is_smooth() => {
                let share = self.facet(o.z) * (1.0 - seen.coat);
                return Some(Scattered::single(straight_back(o), share, chance));
            }
            MIRROR => above(mirrored(o, self.ggx().sample(o, place)))?,
            DIFFUSE => above(cosine_hemisphere(place))?,
            AGAIN => above(self.ggx().bounced(place))?,
            CROSS => above(self.ggx().bounced(place)).map(|i| i.with_z(-i.z))?,
            _ if self.is_clear_smooth() => return self.clear_single(&seen, o, chance, rest, mode),
            _ => self.clear_rough(o, place, rest)?,
        };
        let pdf = self.mixture(&chances, o, direction);
        if pdf.is_nan() || pdf <= 0.0 {
            return None;
        }
        let f = if direction.z > 0.0 {
            self.reflection(&seen, o, direction)
        } else {
            self.transmission(&seen, o, direction, mode)
        };
        let weight = f * (direction.z.abs() / pdf);
        let transmitted = direction.z < 0.0;
        weight.is_finite().then_some(Scattered { direction, weight, pdf, delta: false, transmitted })
    }

    /// All single directions that light is sent on in, each with the whole of its share: by the coat, the mirror, and what is clear.
    pub fn singles(&self, o: Vec3, mode: Transport) -> [Option<Scattered>; SINGLES] {
        let seen = self.sight(o.z, self.inside);
        let coat = (self.coat > 0.0 && !self.inside && self.is_coat_smooth()).then(|| {
            Scattered::single(straight_back(o), Rgb::splat(self.coat * fresnel::dielectric(o.z, COAT_IOR)), 1.0)
        });
        let mirror = (self.is_smooth() && !self.inside)
            .then(|| Scattered::single(straight_back(o), self.facet(o.z) * (1.0 - seen.coat), 1.0));
        let clear = |u: f32| {
            let drawn = self.clear_single(&seen, o, 1.0, u, mode)?;
            Some(Scattered { weight: drawn.weight * drawn.pdf, pdf: 1.0, ..drawn })
        };
        let is_clear = self.clear > 0.0 && self.is_clear_smooth();
        // One draw mirrors at the least, one sends on at the most.
        let [back, on] = [0.0, 1.0].map(|u| if is_clear { clear(u) } else { None });
        [coat, mirror, back.filter(|s| !s.transmitted), on.filter(|s| s.transmitted)]
    }

    /// A direction from a rough clear facet, which mirrors where `u` is below the chance of it.
    fn clear_rough(&self, o: Vec3, place: [f32; 2], u: f32) -> Option<Vec3> {
        let h = self.ggx().sample(o, place);
        if u < self.mirror_chance(self.clear_fresnel(o.dot(h), self.inside)) {
            return Some(mirrored(o, h)).filter(|i| i.z > 0.0);
        }
        let i = match self.kind {
            Clear::Thin => {
                let i = mirrored(o, h);
                i.with_z(-i.z)
            }
            Clear::Solid => refracted(o, h, self.eta())?,
        };
        (i.z < 0.0).then_some(i)
    }

    /// What a smooth clear part mirrors, where `u` is below the chance of it, or sends on.
    fn clear_single(&self, seen: &Sight, o: Vec3, chance: f32, u: f32, mode: Transport) -> Option<Scattered> {
        let fresnel = self.clear_fresnel(o.z, self.inside);
        let mirror = self.mirror_chance(fresnel);
        if u < mirror {
            let share = Rgb::splat(self.clear * fresnel * (1.0 - seen.coat));
            return Some(Scattered::single(straight_back(o), share, chance * mirror));
        }
        let direction = match self.kind {
            Clear::Thin => -o,
            Clear::Solid => refracted(o, Vec3::Z, self.eta())?,
        };
        let lit = self.sight(-direction.z, self.beyond());
        let below = 1.0 - seen.coat.max(lit.coat);
        let share = self.base * (self.clear * below * (1.0 - fresnel) * self.compression(mode));
        (direction.z < 0.0).then(|| Scattered::single(direction, share, chance * (1.0 - mirror)))
    }
}

/// The mirror's direction.
fn straight_back(o: Vec3) -> Vec3 {
    Vec3::new(-o.x, -o.y, o.z)
}

/// The strategy at `u` in [0, 1), its chance, and `u` spread over [0, 1) within it.
fn choose(chances: &[f32; STRATEGIES], u: f32) -> (usize, f32, f32) {
    let (mut low, mut last) = (0.0, 0);
    for (k, &chance) in chances.iter().enumerate().filter(|(_, chance)| **chance > 0.0) {
        last = k;
        if u < low + chance {
            break;
        }
        low += chance;
    }
    let rest = (u - low) / chances[last];
    (last, chances[last], rest.clamp(0.0, 1.0 - f32::EPSILON))
}
