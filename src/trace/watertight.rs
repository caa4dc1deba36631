//! Watertight ray-triangle intersection: no ray slips between two triangles that share an edge.
//!
//! Woop, Benthin, Wald 2013, "Watertight Ray/Triangle Intersection": the triangle is sheared into a space where the ray is
//! the z axis, and the signs of three edge functions decide. An edge function is computed from the same two vertices by the
//! same arithmetic in both triangles, so that they agree exactly; where one is zero in f32 all are computed in f64.

use glam::Vec3;

/// What a ray needs for the test, once a ray.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shear {
    pub origin: [f32; 3],
    pub axes: [usize; 3],
    pub shear: [f32; 3],
}

/// A crossing: the distance and the weights of corners 1 and 2, and whether the front faces the ray.
#[derive(Clone, Copy, Debug)]
pub(super) struct Crossing {
    pub t: f32,
    pub barycentric: [f32; 2],
    pub front: bool,
}

impl Shear {
    #[inline(always)]
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        let d = direction.to_array();
        let size = direction.abs().to_array();
        let kz = if size[0] > size[1] && size[0] > size[2] {
            0
        } else if size[1] > size[2] {
            1
        } else {
            2
        };
        let (mut kx, mut ky) = ((kz + 1) % 3, (kz + 2) % 3);
        // Keeps the winding for rays against the axis.
        if d[kz] < 0.0 {
            std::mem::swap(&mut kx, &mut ky);
        }
        Self { origin: origin.to_array(), axes: [kx, ky, kz], shear: [d[kx] / d[kz], d[ky] / d[kz], 1.0 / d[kz]] }
    }

    /// The crossing with the triangle at 0 < t, on either side.
    #[inline(always)]
    pub fn intersect(&self, triangle: &[[f32; 3]; 3]) -> Option<Crossing> {
        let [kx, ky, kz] = self.axes;
        let [sx, sy, sz] = self.shear;
        let relative = |v: &[f32; 3]| {
            let z = v[kz] - self.origin[kz];
            [v[kx] - self.origin[kx] - sx * z, v[ky] - self.origin[ky] - sy * z, z]
        };
        let [a, b, c] = [relative(&triangle[0]), relative(&triangle[1]), relative(&triangle[2])];
        let mut u = c[0] * b[1] - c[1] * b[0];
        let mut v = a[0] * c[1] - a[1] * c[0];
        let mut w = b[0] * a[1] - b[1] * a[0];
        let apart = |u: f32, v: f32, w: f32| (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0);
        if apart(u, v, w) {
            return None;
        }
        if u == 0.0 || v == 0.0 || w == 0.0 {
            let exact =
                |p: f32, q: f32, r: f32, s: f32| (f64::from(p) * f64::from(q) - f64::from(r) * f64::from(s)) as f32;
            u = exact(c[0], b[1], c[1], b[0]);
            v = exact(a[0], c[1], a[1], c[0]);
            w = exact(b[0], a[1], b[1], a[0]);
            if apart(u, v, w) {
                return None;
            }
        }
        let determinant = u + v + w;
        if determinant == 0.0 {
            return None;
        }
        let inverse = 1.0 / determinant;
        let t = (u * a[2] + v * b[2] + w * c[2]) * sz * inverse;
        // A front face has positive edge functions here: its corners turn counter-clockwise against the ray.
        (t > 0.0).then_some(Crossing { t, barycentric: [v * inverse, w * inverse], front: determinant > 0.0 })
    }
}
