//! Reflectance of smooth interfaces: Fresnel's equations for unpolarised light between dielectrics, and Schlick's
//! curve.

/// Share that an interface between dielectrics reflects, 0..=1. `cos`: of the angle to the normal on the side that
/// light comes from, 0..=1; `eta`: index of refraction beyond over that on this side. 1 beyond the critical angle.
pub fn dielectric(cos: f32, eta: f32) -> f32 {
    if eta == 1.0 {
        return 0.0;
    }
    let cos = cos.clamp(0.0, 1.0);
    let sin2_t = (1.0 - cos * cos) / (eta * eta);
    if sin2_t >= 1.0 {
        return 1.0;
    }
    let cos_t = (1.0 - sin2_t).sqrt();
    let parallel = (eta * cos - cos_t) / (eta * cos + cos_t);
    let perpendicular = (cos - eta * cos_t) / (cos + eta * cos_t);
    (parallel * parallel + perpendicular * perpendicular) * 0.5
}

/// Reflectance head-on between dielectrics.
pub fn head_on(eta: f32) -> f32 {
    let ratio = (eta - 1.0) / (eta + 1.0);
    ratio * ratio
}

/// (1 - cos)^5: how reflectance rises from its value head-on to 1 (Schlick 1994).
pub fn schlick(cos: f32) -> f32 {
    let m = (1.0 - cos).clamp(0.0, 1.0);
    let m2 = m * m;
    m2 * m2 * m
}

/// How the reflectance of a dielectric rises from 0 head-on to 1 at grazing angles, seen from outside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rise {
    /// As Fresnel's equations have it for this index, more than 1.
    Index(f32),
    Schlick,
}

impl Rise {
    /// The curve for index `ior`; 0 and 1 have no curve of their own.
    pub fn new(ior: f32) -> Self {
        if ior > 1.0 { Self::Index(ior) } else { Self::Schlick }
    }

    /// 0..=1 at the angle of `cos`.
    pub fn at(self, cos: f32) -> f32 {
        match self {
            Self::Index(ior) => {
                let f0 = head_on(ior);
                (dielectric(cos, ior) - f0) / (1.0 - f0)
            }
            Self::Schlick => schlick(cos),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reflectance_is_as_known() {
        assert!((dielectric(1.0, 1.5) - 0.04).abs() < 1e-6);
        assert!((dielectric(1.0, 1.0 / 1.5) - 0.04).abs() < 1e-6);
        assert_eq!(dielectric(0.0, 1.5), 1.0);
        // Brewster's angle, tan = 1.5: p light passes whole, and half of ((n^2 - 1) / (n^2 + 1))^2 is left.
        let cos = 1.0 / (1.0f32 + 2.25).sqrt();
        assert!((dielectric(cos, 1.5) - 0.5 * (1.25f32 / 3.25).powi(2)).abs() < 1e-6);
        // Beyond the critical angle all comes back, and the same shares do on both sides of one ray.
        assert_eq!(dielectric(0.7, 1.0 / 1.5), 1.0);
        let cos_t = (1.0f32 - (1.0 - 0.36) / 2.25).sqrt();
        assert!((dielectric(0.6, 1.5) - dielectric(cos_t, 1.0 / 1.5)).abs() < 1e-6);
        assert_eq!((Rise::new(1.5).at(1.0), Rise::new(1.5).at(0.0)), (0.0, 1.0));
    }
}
