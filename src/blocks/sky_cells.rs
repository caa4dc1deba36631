//! The openings through which the sky is seen, found by rays that escaped: no portals need to be placed.
//!
//! A ray that escapes leaves the scene's box through one of its six faces. The bundle of all that leave through one face is
//! narrowest where the openings are, a skylight below a roof or a window behind a reveal, so a plane parallel to the face is put at
//! the waist of its bundle. The plane's cells that rays came through are what area samples are drawn from.

use glam::{Vec2, Vec3};

/// Cells along each side of a plane.
const SIDE: usize = 64;

/// Places of a plane that are tried, from the box's face inwards.
const DEPTHS: usize = 48;

/// Openings of a face at most; neighbouring cells are joined until there are no more.
const MOST_OPENINGS: usize = 48;

/// The share of rays that must start before a plane.
const LEAST_BEFORE: f64 = 0.95;

/// A plane further inside is taken where its bundle is narrower by at least this factor.
const NARROWER: f64 = 0.98;

/// A ray that escaped, with its share of a receiver's light (luminance).
#[derive(Clone, Copy, Debug)]
pub struct Escaped {
    pub origin: Vec3,
    pub direction: Vec3,
    /// Radiance [nit].
    pub radiance: f32,
}

/// A set of cells that the sky is seen through.
#[derive(Clone, Copy, Debug)]
pub struct Opening {
    pub centre: Vec3,
    /// Into the scene, unit.
    pub normal: Vec3,
    pub radius: f32,
    /// Area [m^2], and mean radiance of the sky behind it [nit].
    pub area: f32,
    pub radiance: f32,
}

/// A plane parallel to a face of the box.
struct Plane {
    /// Axis across it, and the sign of its outward normal.
    axis: usize,
    outward: f32,
    /// Its coordinate along the axis.
    at: f32,
    /// Lowest corner and size of a cell, along the two other axes.
    low: Vec2,
    cell: Vec2,
    /// The opening of each cell, `u16::MAX` where none is.
    opening: Vec<u16>,
}

/// Openings on up to six planes.
pub struct SkyCells {
    low: Vec3,
    high: Vec3,
    planes: Vec<Plane>,
    openings: Vec<Opening>,
    /// Plane and cells of each opening.
    cells: Vec<(usize, Vec<u32>)>,
}

/// No opening.
const NONE: u16 = u16::MAX;

impl SkyCells {
    /// No sky.
    pub fn none() -> Self {
        Self { low: Vec3::ZERO, high: Vec3::ZERO, planes: Vec::new(), openings: Vec::new(), cells: Vec::new() }
    }

    /// Finds the openings of a scene in the box from `low` to `high` [m] by rays that escaped from it.
    pub fn new(low: Vec3, high: Vec3, escaped: &[Escaped]) -> Self {
        let mut all = Self { low, high, ..Self::none() };
        for face in 0..6 {
            let (axis, outward) = (face / 2, if face % 2 == 0 { -1.0 } else { 1.0 });
            let bundle: Vec<Escaped> =
                escaped.iter().filter(|e| all.exit(e.origin, e.direction) == Some(face)).copied().collect();
            if !bundle.is_empty() {
                all.add_plane(axis, outward, &bundle);
            }
        }
        all
    }

    /// All openings, numbered in this order.
    pub fn openings(&self) -> impl Iterator<Item = Opening> + '_ {
        self.openings.iter().copied()
    }

    /// The face of the box (axis times 2, plus 1 for the far one) through which a ray leaves.
    fn exit(&self, origin: Vec3, direction: Vec3) -> Option<usize> {
        let mut best: Option<(f32, usize)> = None;
        for axis in 0..3 {
            let d = direction[axis];
            if d != 0.0 {
                let wall = if d > 0.0 { self.high[axis] } else { self.low[axis] };
                let t = (wall - origin[axis]) / d;
                if best.is_none_or(|(least, _)| t < least) {
                    best = Some((t, 2 * axis + usize::from(d > 0.0)));
                }
            }
        }
        best.map(|b| b.1)
    }

    /// Opening `o`.
    pub fn opening(&self, o: usize) -> Opening {
        self.openings[o]
    }

    /// A point uniform over opening `o`.
    pub fn point(&self, o: usize, u: [f32; 2]) -> Vec3 {
        let (p, cells) = &self.cells[o];
        let x = u[0] * cells.len() as f32;
        let k = (x as usize).min(cells.len() - 1);
        self.planes[*p].point(cells[k] as usize, [x - k as f32, u[1]])
    }

    /// A direction from `origin` through opening `o`, uniform over its cells; `None` where the opening is seen from its outside
    /// or the way through it leaves the box through another face.
    pub fn sample(&self, o: usize, origin: Vec3, u: [f32; 2]) -> Option<Vec3> {
        let plane = &self.planes[self.cells[o].0];
        let to = self.point(o, u);
        let direction = (to - origin).try_normalize()?;
        let is_inside = (to[plane.axis] - origin[plane.axis]) * plane.outward > 0.0;
        (is_inside && self.exit(origin, direction) == Some(plane.face())).then_some(direction)
    }

    /// The opening that a ray through the sky passes, and the density [1/sr] with which [`sample`](Self::sample) draws its
    /// direction.
    pub fn find(&self, origin: Vec3, direction: Vec3) -> Option<(usize, f32)> {
        let face = self.exit(origin, direction)?;
        let plane = self.planes.iter().find(|p| p.face() == face)?;
        let (t, cell) = plane.cross(origin, direction)?;
        let o = plane.opening[cell];
        (o != NONE).then(|| {
            let cos = direction[plane.axis].abs().max(1e-4);
            (o as usize, t * t / (cos * self.openings[o as usize].area))
        })
    }

    /// Finds the plane of the rays in `bundle`, and its openings.
    fn add_plane(&mut self, axis: usize, outward: f32, bundle: &[Escaped]) {
        let (near, far) =
            if outward > 0.0 { (self.high[axis], self.low[axis]) } else { (self.low[axis], self.high[axis]) };
        let mut best: Option<(usize, Plane)> = None;
        for depth in 0..DEPTHS {
            // Openings lie near the hull more often than deep inside.
            let share = (depth as f32 / DEPTHS as f32).powi(2);
            let mut plane = Plane::new(self.low, self.high, axis, outward, near + (far - near) * share);
            let crossed = bundle.iter().filter_map(|e| plane.cross(e.origin, e.direction));
            let cells: Vec<usize> = crossed.map(|(_, cell)| cell).collect();
            if (cells.len() as f64) < LEAST_BEFORE * bundle.len() as f64 {
                break;
            }
            cells.iter().for_each(|&cell| plane.opening[cell] = 0);
            let width = plane.opening.iter().filter(|o| **o == 0).count();
            if best.as_ref().is_none_or(|(least, _)| (width as f64) < NARROWER * *least as f64) {
                best = Some((width, plane));
            }
        }
        let Some((_, mut plane)) = best else { return };
        let mut flux = vec![(0.0f64, 0u32); SIDE * SIDE];
        for e in bundle {
            if let Some((_, cell)) = plane.cross(e.origin, e.direction) {
                flux[cell].0 += f64::from(e.radiance);
                flux[cell].1 += 1;
            }
        }
        // Cells are joined in squares of 1, 2, 4, ... a side until there are few enough.
        let mut level = 0;
        let groups = loop {
            let mut groups: std::collections::BTreeMap<usize, Vec<u32>> = Default::default();
            for cell in (0..SIDE * SIDE).filter(|&c| plane.opening[c] == 0) {
                let (x, y) = (cell % SIDE, cell / SIDE);
                groups.entry((y >> level) * SIDE + (x >> level)).or_default().push(cell as u32);
            }
            if groups.len() <= MOST_OPENINGS {
                break groups;
            }
            level += 1;
        };
        let number = self.planes.len();
        for cells in groups.into_values() {
            let o = self.openings.len();
            let corners: Vec<Vec3> = cells.iter().map(|&c| plane.point(c as usize, [0.5, 0.5])).collect();
            let centre = corners.iter().sum::<Vec3>() / corners.len() as f32;
            let cell_radius = 0.5 * plane.cell.length();
            let (sum, count) =
                cells.iter().fold((0.0, 0u32), |(s, n), &c| (s + flux[c as usize].0, n + flux[c as usize].1));
            let mut normal = Vec3::ZERO;
            normal[axis] = -outward;
            self.openings.push(Opening {
                centre,
                normal,
                radius: corners.iter().map(|c| c.distance(centre)).fold(0.0, f32::max) + cell_radius,
                area: cells.len() as f32 * plane.cell.element_product(),
                radiance: (sum / f64::from(count.max(1))) as f32,
            });
            cells.iter().for_each(|&c| plane.opening[c as usize] = o as u16);
            self.cells.push((number, cells));
        }
        self.planes.push(plane);
    }
}

impl Plane {
    fn new(low: Vec3, high: Vec3, axis: usize, outward: f32, at: f32) -> Self {
        let flat = |v: Vec3| Vec2::new(v[(axis + 1) % 3], v[(axis + 2) % 3]);
        let cell = (flat(high) - flat(low)) / SIDE as f32;
        Self { axis, outward, at, low: flat(low), cell, opening: vec![NONE; SIDE * SIDE] }
    }

    fn face(&self) -> usize {
        2 * self.axis + usize::from(self.outward > 0.0)
    }

    /// Where a ray crosses it outwards: the distance and the cell.
    fn cross(&self, origin: Vec3, direction: Vec3) -> Option<(f32, usize)> {
        let t = (self.at - origin[self.axis]) / direction[self.axis];
        if !(t > 0.0 && t.is_finite() && direction[self.axis] * self.outward > 0.0) {
            return None;
        }
        let to = origin + direction * t;
        let p = (Vec2::new(to[(self.axis + 1) % 3], to[(self.axis + 2) % 3]) - self.low) / self.cell;
        let is_within = p.cmpge(Vec2::ZERO).all() && p.cmplt(Vec2::splat(SIDE as f32)).all();
        is_within.then(|| (t, p.y as usize * SIDE + p.x as usize))
    }

    /// The point at `u` of the unit square of cell `cell`.
    fn point(&self, cell: usize, u: [f32; 2]) -> Vec3 {
        let p = self.low + (Vec2::new((cell % SIDE) as f32, (cell / SIDE) as f32) + Vec2::from(u)) * self.cell;
        let mut to = Vec3::ZERO;
        to[self.axis] = self.at;
        to[(self.axis + 1) % 3] = p.x;
        to[(self.axis + 2) % 3] = p.y;
        to
    }
}
