//! Bounds on a set of patches: enough to tell that two sets can't see each other, and how much they can exchange at most.

use glam::Vec3;
use std::f32::consts::{FRAC_PI_2, PI};

/// What rises by less than this share of its size is flat: angles of normals in f32 are about that far off.
const FLAT: f32 = 2e-3;

/// Bounds on a set of patches.
#[derive(Clone, Copy, Debug)]
pub struct Cluster {
    /// Area [m^2].
    pub area: f32,
    /// Area-weighted centre [m].
    pub centre: Vec3,
    /// Largest distance of a point from the centre [m].
    pub radius: f32,
    /// Mean normal, unit.
    pub axis: Vec3,
    /// Largest angle of a normal to the axis [rad], 0..=pi.
    pub spread: f32,
    /// How far it rises over its plane, relative to its radius: sin(spread).
    pub bulge: f32,
}

impl Cluster {
    /// Bounds from their parts.
    pub fn new(area: f32, centre: Vec3, radius: f32, axis: Vec3, spread: f32) -> Self {
        let spread = spread.min(PI);
        let bulge = if spread < FRAC_PI_2 { spread.sin() } else { 1.0 };
        Self { area, centre, radius, axis, spread, bulge }
    }

    /// Bounds on both.
    pub fn joined(&self, other: &Self) -> Self {
        let area = self.area + other.area;
        let centre = (self.centre * self.area + other.centre * other.area) / area.max(f32::MIN_POSITIVE);
        let radius = [self, other].map(|c| c.centre.distance(centre) + c.radius);
        let axis = (self.axis * self.area + other.axis * other.area).normalize_or(self.axis);
        let spread = [self, other].map(|c| axis.dot(c.axis).clamp(-1.0, 1.0).acos() + c.spread);
        Self::new(area, centre, radius[0].max(radius[1]), axis, spread[0].max(spread[1]))
    }

    /// False where one lies wholly behind the other, as far as both are flat: neighbours on one wall touch, and yet don't see
    /// each other.
    pub fn can_see(&self, other: &Self) -> bool {
        let across = (1.0 - self.axis.dot(other.axis).powi(2)).max(0.0).sqrt();
        let way = other.centre - self.centre;
        let flat = FLAT * (self.radius + other.radius);
        let in_front =
            |of: &Self, o: &Self, height: f32| height + o.radius * (across + o.bulge) + of.radius * of.bulge > flat;
        in_front(self, other, way.dot(self.axis)) && in_front(other, self, -way.dot(other.axis))
    }

    /// The largest cosine that a normal of it can have to the way to any point of `other`; 0 where all of them face away.
    pub fn most_cosine(&self, other: &Self) -> f32 {
        let way = other.centre - self.centre;
        let distance = way.length();
        let reach = self.radius + other.radius;
        if distance <= reach {
            return 1.0;
        }
        let between = (self.axis.dot(way) / distance).clamp(-1.0, 1.0).acos();
        let least = (between - self.spread - (reach / distance).asin()).max(0.0);
        if least >= FRAC_PI_2 { 0.0 } else { least.cos() }
    }

    /// A bound on the form factor between any point of this cluster and `other`; infinite where they may touch.
    pub fn most_form_factor(&self, other: &Self) -> f32 {
        let way = other.centre - self.centre;
        let reach = self.radius + other.radius;
        let gap = way.length() - reach;
        if gap <= 0.0 {
            return f32::INFINITY;
        }
        let cosine = |c: &Self, towards: f32| ((towards + reach) / gap + c.bulge).clamp(0.0, 1.0);
        cosine(self, way.dot(self.axis)) * cosine(other, -way.dot(other.axis)) * other.area / (PI * gap * gap)
    }
}
