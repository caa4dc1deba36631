//! Vertices of paths: places where light is sent on.

use crate::color::Rgb;
use crate::light::terminator;
use crate::medium::Phase;
use crate::patch::SurfacePoint;
use crate::sample::Numbers;
use crate::sample::warp::frame;
use crate::scatter::{Bsdf, Scattered, Transport};
use crate::trace::{Hit, Tracer};
use glam::{Mat3, Vec3};

/// A place where light is sent on, as it is met along a direction.
#[derive(Clone, Copy, Debug)]
pub struct Vertex<'a> {
    /// World position [m].
    pub position: Vec3,
    /// Unit, towards where the path came from.
    pub back: Vec3,
    pub kind: Kind<'a>,
}

/// What a vertex lies on: nearly always a surface, which is kept in place.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Copy, Debug)]
pub enum Kind<'a> {
    Surface(OnSurface<'a>),
    Medium(Phase),
}

/// A place on a surface.
#[derive(Clone, Copy, Debug)]
pub struct OnSurface<'a> {
    pub point: SurfacePoint,
    /// World directions from the BSDF's own: about the shading normal of the front.
    pub world_from_local: Mat3,
    pub bsdf: Bsdf<'a>,
    /// How the surface was met; none where the path starts.
    pub hit: Option<Hit>,
}

/// A way that light goes on.
#[derive(Clone, Copy, Debug)]
pub struct Onward {
    pub direction: Vec3,
    /// What the path's weight is multiplied by.
    pub weight: Rgb,
    /// Density [1/sr]; 0 where there was no choice but among deltas.
    pub pdf: f32,
    /// It goes through the surface.
    pub transmitted: bool,
}

impl<'a> Vertex<'a> {
    /// A vertex on a surface whose front is lit as `bsdf` says, met along `-back`.
    pub fn on_surface(point: SurfacePoint, bsdf: Bsdf<'a>, back: Vec3, hit: Option<Hit>) -> Self {
        let on = OnSurface { world_from_local: frame(point.shading), point, bsdf, hit };
        Self { position: point.position, back, kind: Kind::Surface(on) }
    }

    /// The surface that it lies on.
    pub fn surface(&self) -> Option<&OnSurface<'a>> {
        match &self.kind {
            Kind::Surface(on) => Some(on),
            Kind::Medium(_) => None,
        }
    }

    /// True where only deltas send light on, so that no other vertex can be joined to it.
    pub fn is_delta(&self) -> bool {
        self.surface().is_some_and(|on| on.bsdf.is_delta())
    }

    /// The normal that light must come from the side of, for choosing lights: zero where it may come from anywhere.
    pub fn facing(&self) -> Vec3 {
        match self.surface() {
            Some(on) if !on.bsdf.transmits() => on.front_towards(self.back),
            _ => Vec3::ZERO,
        }
    }

    /// The share of light from the unit vector `towards` that goes back along the path, times the cosine [1/sr].
    pub fn respond(&self, towards: Vec3, mode: Transport) -> Rgb {
        match &self.kind {
            Kind::Medium(phase) => Rgb::splat(phase.between(self.back, towards)),
            Kind::Surface(on) => on.respond(self.back, towards, mode),
        }
    }

    /// Density [1/sr] with which [`Self::go_on`] takes the unit vector `towards`, among those that are no deltas.
    pub fn pdf(&self, towards: Vec3, mode: Transport) -> f32 {
        self.pdf_between(self.back, towards, mode)
    }

    /// The same where the path had come from the unit vector `from`.
    pub fn pdf_between(&self, from: Vec3, towards: Vec3, mode: Transport) -> f32 {
        match &self.kind {
            Kind::Medium(phase) => phase.between(from, towards),
            Kind::Surface(on) => on.pdf(from, towards, mode),
        }
    }

    /// All single directions in which mirrors and glass send light on.
    pub fn mirrors(&self, mode: Transport) -> impl Iterator<Item = Onward> {
        self.surface().filter(|on| on.agrees(self.back)).into_iter().flat_map(move |on| on.mirrors(self.back, mode))
    }

    /// Where the path goes on; `None` where it ends.
    pub fn go_on(&self, mode: Transport, numbers: &mut impl Numbers) -> Option<Onward> {
        let u = numbers.triple();
        match &self.kind {
            Kind::Medium(phase) => {
                let (direction, pdf) = phase.sample(self.back, [u[0], u[1]]);
                Some(Onward { direction, weight: Rgb::ONE, pdf, transmitted: false })
            }
            Kind::Surface(on) => on.go_on(self.back, mode, u),
        }
    }

    /// The same place, kept off its surface to the side of `towards`.
    pub fn origin(&self, tracer: &Tracer, towards: Vec3) -> Vec3 {
        match self.surface() {
            Some(on) => tracer.off_surface(self.position, on.front_towards(towards)),
            None => self.position,
        }
    }

    /// The same for shadow rays, which start from the round surface that interpolated normals belong to.
    pub fn shadow_origin(&self, tracer: &Tracer, towards: Vec3) -> Vec3 {
        match self.surface() {
            Some(on) if on.point.normal.dot(towards) > 0.0 => terminator::origin(tracer, &on.point),
            _ => self.origin(tracer, towards),
        }
    }
}

impl OnSurface<'_> {
    /// The triangle's normal on the side of `towards`.
    pub fn front_towards(&self, towards: Vec3) -> Vec3 {
        let normal = self.point.normal;
        if normal.dot(towards) < 0.0 { -normal } else { normal }
    }

    fn local(&self, d: Vec3) -> Vec3 {
        self.world_from_local.transpose() * d
    }

    /// True where both normals have `d` on one side: else light would leak through what interpolated normals bend.
    fn agrees(&self, d: Vec3) -> bool {
        self.point.normal.dot(d) * self.point.shading.dot(d) > 0.0
    }

    /// What interpolated normals change of light on its way from a light (Veach 1997, section 5.3.2): 1 where there are none.
    fn correction(&self, from: Vec3, towards: Vec3, mode: Transport) -> f32 {
        if mode == Transport::Radiance || self.point.normal == self.point.shading {
            return 1.0;
        }
        let [geometric, shading] = [self.point.normal, self.point.shading].map(|n| (n.dot(from), n.dot(towards)));
        (shading.0 * geometric.1 / (geometric.0 * shading.1)).abs()
    }

    fn respond(&self, from: Vec3, towards: Vec3, mode: Transport) -> Rgb {
        if !self.agrees(from) || !self.agrees(towards) {
            return Rgb::ZERO;
        }
        let (wo, wi) = (self.local(from), self.local(towards));
        self.bsdf.evaluate(wo, wi, mode) * (wi.z.abs() * self.correction(from, towards, mode))
    }

    fn pdf(&self, from: Vec3, towards: Vec3, mode: Transport) -> f32 {
        self.bsdf.pdf(self.local(from), self.local(towards), mode)
    }

    fn go_on(&self, from: Vec3, mode: Transport, u: [f32; 3]) -> Option<Onward> {
        if !self.agrees(from) {
            return None;
        }
        self.onward(from, mode, self.bsdf.sample(self.local(from), u, mode)?)
    }

    fn mirrors(&self, from: Vec3, mode: Transport) -> impl Iterator<Item = Onward> {
        let singles = self.bsdf.singles(self.local(from), mode).into_iter().flatten();
        singles.filter_map(move |single| self.onward(from, mode, single))
    }

    /// What was drawn, in world space; `None` where the triangle itself is in the way.
    fn onward(&self, from: Vec3, mode: Transport, scattered: Scattered) -> Option<Onward> {
        let direction = (self.world_from_local * scattered.direction).normalize();
        self.agrees(direction).then(|| Onward {
            direction,
            weight: scattered.weight * self.correction(from, direction, mode),
            pdf: if scattered.delta { 0.0 } else { scattered.pdf },
            transmitted: scattered.transmitted,
        })
    }
}
