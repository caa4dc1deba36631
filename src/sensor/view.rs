//! A picture that a camera takes.

use super::{Seen, Sensor, Start};
use crate::sample::{Numbers, warp::disc};
use crate::scene::{Camera, Projection};
use crate::trace::{Hit, Ray};
use glam::{Vec2, Vec3};

/// The pixels of a picture through a camera, row by row from the top left.
#[derive(Clone, Debug)]
pub struct View {
    camera: Camera,
    width: u32,
    height: u32,
    /// Half the picture's extent: tangents of angles, or metres.
    half: Vec2,
}

impl View {
    /// A picture of `width` x `height` pixels, each at least 1. It sees the camera's whole height.
    pub fn new(camera: Camera, width: u32, height: u32) -> Self {
        let (Projection::Perspective { half_height, .. } | Projection::Orthographic { half_height }) =
            camera.projection;
        let half = Vec2::new(half_height * width as f32 / height as f32, half_height);
        Self { camera, width, height, half }
    }

    /// The same picture in squares of `side` x `side` pixels.
    pub fn in_squares(&self, side: u32) -> Self {
        let of = |pixels: u32| pixels.div_ceil(side.max(1)).max(1);
        Self { width: of(self.width), height: of(self.height), ..self.clone() }
    }

    /// Width and height [pixels].
    pub fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// Where in the picture, -1..=1 to the right and up, place `at` of pixel `pixel` is, `at` in the unit square, v down.
    fn place(&self, pixel: usize, at: [f32; 2]) -> Vec2 {
        let (x, y) = (pixel as u32 % self.width, pixel as u32 / self.width);
        let across = (x as f32 + at[0]) / self.width as f32;
        let down = (y as f32 + at[1]) / self.height as f32;
        Vec2::new(2.0 * across - 1.0, 1.0 - 2.0 * down)
    }

    /// The pixel at a place in the picture, where it lies within.
    fn pixel(&self, place: Vec2) -> Option<usize> {
        let at = Vec2::new(0.5 + 0.5 * place.x, 0.5 - 0.5 * place.y) * Vec2::new(self.width as f32, self.height as f32);
        let is_within = at.x >= 0.0 && at.y >= 0.0 && at.x < self.width as f32 && at.y < self.height as f32;
        is_within.then(|| at.y as usize * self.width as usize + at.x as usize)
    }

    /// Area of the picture at distance 1 [1], or of what an orthographic camera sees [m^2].
    fn area(&self) -> f32 {
        4.0 * self.half.x * self.half.y
    }

    fn shift(&self) -> Vec2 {
        match self.camera.projection {
            Projection::Perspective { shift, .. } => shift,
            Projection::Orthographic { .. } => Vec2::ZERO,
        }
    }

    /// The ray through a place in the picture and the place on the lens that `u` picks.
    fn ray(&self, place: Vec2, u: [f32; 2]) -> Ray {
        let Camera { position, world_from_camera, .. } = self.camera;
        let on_plane = self.half * (place + self.shift());
        if let Projection::Orthographic { .. } = self.camera.projection {
            return Ray {
                origin: position + world_from_camera * on_plane.extend(0.0),
                direction: -world_from_camera.z_axis,
            };
        }
        let through = on_plane.extend(-1.0);
        let Some(lens) = self.camera.lens else {
            return Ray { origin: position, direction: world_from_camera * through.normalize() };
        };
        let on_lens = (disc(u) * lens.radius).extend(0.0);
        let towards = through * lens.focus - on_lens;
        Ray { origin: position + world_from_camera * on_lens, direction: world_from_camera * towards.normalize() }
    }
}

impl Sensor for View {
    fn len(&self) -> usize {
        self.width as usize * self.height as usize
    }

    fn size(&self) -> Option<[u32; 2]> {
        Some([self.width, self.height])
    }

    fn start(&self, pixel: usize, numbers: &mut dyn Numbers) -> Option<Start> {
        let at = numbers.pair();
        let u = if self.camera.lens.is_some() { numbers.pair() } else { [0.5; 2] };
        Some(Start::Ray(self.ray(self.place(pixel, at), u)))
    }

    fn see(&self, position: Vec3, u: [f32; 2]) -> Option<Seen> {
        // Parallel rays of one direction are met by no path from a light.
        let Projection::Perspective { .. } = self.camera.projection else { return None };
        let to_camera = self.camera.world_from_camera.transpose();
        let on_lens = self.camera.lens.map_or(Vec2::ZERO, |lens| disc(u) * lens.radius);
        let from = self.camera.position + self.camera.world_from_camera * on_lens.extend(0.0);
        let way = to_camera * (position - from);
        let depth = -way.z;
        if depth <= 0.0 {
            return None;
        }
        // Where the ray meets the plane that is sharp, as the picture at distance 1 has it.
        let slope = way.truncate() / depth;
        let on_plane = self.camera.lens.map_or(slope, |lens| slope + on_lens / lens.focus);
        let pixel = self.pixel(on_plane / self.half - self.shift())?;
        let distance_squared = way.length_squared();
        let cos = depth / distance_squared.sqrt();
        // A pixel is the mean over its square: of area A / n at distance 1, dA = d omega / cos^3.
        let pixels = self.len() as f32;
        Some(Seen { pixel, from, weight: pixels / (self.area() * cos * cos * cos * distance_squared) })
    }

    fn direction_pdf(&self, direction: Vec3) -> f32 {
        let Projection::Perspective { .. } = self.camera.projection else { return 0.0 };
        let cos = -self.camera.world_from_camera.z_axis.dot(direction);
        if cos > 0.0 { 1.0 / (self.area() * cos * cos * cos) } else { 0.0 }
    }

    fn under(&self, _: &Hit) -> Option<usize> {
        None
    }

    fn area(&self, _: usize) -> f32 {
        1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{Drawn, sequence::Stage};
    use crate::scene::Lens;

    fn views() -> Vec<View> {
        let plain = Camera::look_at(Vec3::new(1.0, 2.0, 3.0), Vec3::new(0.0, 0.5, -1.0), 1.0).unwrap();
        let shift = Vec2::new(0.3, -0.1);
        let shifted = Camera { projection: Projection::Perspective { half_height: 0.4, shift }, ..plain.clone() };
        let lens = Some(Lens { radius: 0.05, focus: 2.0 });
        [plain, shifted.clone(), Camera { lens, ..shifted }].map(|camera| View::new(camera, 37, 23)).to_vec()
    }

    #[test]
    fn what_a_pixel_looks_at_is_seen_in_it() {
        for view in views() {
            for pixel in [0, 17, 400, view.len() - 1] {
                // Away from the pixel's rim, on which rounding decides.
                let u = [0.3, 0.8];
                let ray = view.ray(view.place(pixel, [0.4, 0.7]), u);
                let seen = view.see(ray.origin + ray.direction * 3.7, u).unwrap();
                assert_eq!(seen.pixel, pixel);
                assert!(seen.from.distance(ray.origin) < 1e-6);
            }
            assert!(view.see(Vec3::new(2.0, 4.0, 9.0), [0.5; 2]).is_none(), "behind the camera");
        }
    }

    #[test]
    fn what_is_seen_of_a_plane_of_points_adds_up_to_its_radiance() {
        // A Lambertian plane of radiance 1 across the view: intensities cos dA, over its area, in every pixel.
        let camera = Camera::look_at(Vec3::ZERO, Vec3::NEG_Z, 1.2).unwrap();
        let view = View::new(camera, 4, 3);
        let mut sums = vec![0.0f64; view.len()];
        let (n, half) = (600, 3.0);
        let step = 2.0 * half / n as f32;
        for k in 0..n * n {
            let (x, y) = ((k % n) as f32 + 0.5, (k / n) as f32 + 0.5);
            let at = Vec3::new(x * step - half, y * step - half, -2.0);
            if let Some(seen) = view.see(at, [0.5; 2]) {
                let cos = 2.0 / at.length();
                sums[seen.pixel] += f64::from(cos * step * step * seen.weight);
            }
        }
        assert!(sums.iter().all(|s| (s - 1.0).abs() < 0.02), "{sums:?}");
    }

    #[test]
    fn directions_have_the_density_that_is_said() {
        // The mean of 1 / density over starts is the solid angle of the picture.
        let view = &views()[0];
        let mut sum = 0.0;
        for pixel in 0..view.len() {
            for k in 0..16 {
                let mut numbers = Drawn::new(1, Stage::Path, pixel as u64, k);
                let Some(Start::Ray(ray)) = view.start(pixel, &mut numbers) else { panic!() };
                sum += f64::from(1.0 / view.direction_pdf(ray.direction));
            }
        }
        let mean = sum / (16 * view.len()) as f64;
        let (a, b) = (f64::from(view.half.x), f64::from(view.half.y));
        let whole = 4.0 * (a * b / ((1.0 + a * a) * (1.0 + b * b)).sqrt()).asin();
        assert!((mean / whole - 1.0).abs() < 1e-3, "{mean} {whole}");
    }
}
