//! Portals to a sky with a picture: directions are drawn by the picture's brightness and over the portal, and combined by the power
//! heuristic (Veach, Guibas 1995). Portals to a constant sky are polygons, whose light is known without samples.

use super::sky::Sky;
use crate::patch::SurfacePoint;
use crate::scene::{Light, LightShape, Linked, Scene};
use glam::Vec3;

/// A parallelogram through which a sky with a picture shines.
pub struct Portal {
    center: Vec3,
    /// Half edges.
    u: Vec3,
    v: Vec3,
    /// Into the scene, unit.
    normal: Vec3,
    area: f32,
    sky: Sky,
    lit: Linked,
    shade: Option<u16>,
}

/// A direction through a portal.
pub struct Drawn<'a> {
    pub towards: Vec3,
    /// What the sky's radiance is multiplied by: the share of the strategy over its density [sr].
    pub weight: f32,
    pub sky: &'a Sky,
}

impl Portal {
    /// `None` for other lights, and for portals to a constant sky.
    pub fn new(scene: &Scene, light: &Light, shade: Option<u16>) -> Option<Self> {
        let LightShape::Portal { center, u, v, sky } = &light.shape else { return None };
        let across = u.cross(*v);
        let normal = -across.try_normalize()?;
        let area = 4.0 * across.length();
        let lit = light.links.lit.clone();
        let sky = (!sky.is_constant()).then(|| Sky::new(scene, sky))?;
        Some(Self { center: *center, u: *u, v: *v, normal, area, sky, lit, shade })
    }

    /// Its number among [`super::Lights::shades`]; none where every surface blocks it.
    pub fn shade(&self) -> Option<u16> {
        self.shade
    }

    /// Lets `shade` block it.
    pub(super) fn set_shade(&mut self, shade: Option<u16>) {
        self.shade = shade;
    }

    /// A direction from `point` through the portal by the two numbers `u`: over the portal, or by brightness. Weighed so that the
    /// means of both strategies add up. `None` where it passes the portal by.
    pub fn sample(&self, point: &SurfacePoint, u: [f32; 2], by_place: bool) -> Option<Drawn<'_>> {
        if !self.lit.holds(point.surface) {
            return None;
        }
        let towards = if by_place {
            let at = self.center + self.u * (2.0 * u[0] - 1.0) + self.v * (2.0 * u[1] - 1.0);
            (at - point.position).try_normalize()?
        } else {
            self.sky.sample([u[0], u[1], u[1]])?.0
        };
        let over_portal = self.pdf(point.position, towards)?;
        let by_brightness = self.sky.pdf(towards);
        let (own, other) = if by_place { (over_portal, by_brightness) } else { (by_brightness, over_portal) };
        // own^2 / (own^2 + other^2) / own, without overflow.
        let weight = 1.0 / (own * (1.0 + (other / own).powi(2)));
        weight.is_finite().then_some(Drawn { towards, weight, sky: &self.sky })
    }

    /// Density [1/sr] of directions to places uniform over the portal; `None` where `towards` passes it by or comes from inside.
    fn pdf(&self, position: Vec3, towards: Vec3) -> Option<f32> {
        let leaving = -towards.dot(self.normal);
        let t = (position - self.center).dot(self.normal) / leaving;
        if leaving <= 0.0 || t <= 0.0 {
            return None;
        }
        let way = position + towards * t - self.center;
        let n = self.u.cross(self.v);
        let square = n.length_squared();
        let (s, r) = (way.cross(self.v).dot(n) / square, self.u.cross(way).dot(n) / square);
        // What is drawn on the rim may round to the outside.
        let inside = s.abs() <= 1.0 + 1e-5 && r.abs() <= 1.0 + 1e-5;
        inside.then(|| t * t / (leaving * self.area))
    }
}
