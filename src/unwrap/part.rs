//! What goes to an unwrapper and what comes back, whichever it is.

/// A connected part of a mesh.
#[derive(Clone, Debug, Default)]
pub struct Part {
    /// Vertex positions; those of one place share one vertex. Edges are about 1 long.
    pub positions: Vec<[f32; 3]>,
    /// Vertex indices, all in range.
    pub triangles: Vec<[u32; 3]>,
    /// The polygon of each triangle, by any number.
    pub polygons: Vec<u32>,
}

/// What an unwrapper makes of a [`Part`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Unwrapped {
    /// The chart of each triangle, or `u32::MAX` where it was left out.
    pub chart: Vec<u32>,
    pub chart_count: u32,
    /// UVs of each triangle's corners.
    pub uv: Vec<[[f64; 2]; 3]>,
}

impl Unwrapped {
    /// `count` triangles without a chart.
    pub fn none(count: usize) -> Self {
        Self { chart: vec![u32::MAX; count], chart_count: 0, uv: vec![[[0.0; 2]; 3]; count] }
    }
}
