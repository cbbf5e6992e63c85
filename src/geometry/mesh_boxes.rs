//! Boxes around a surface's parts: how a large mesh, a terrain of one piece, is known better than by
//! one box.

use glam::{UVec2, Vec2, Vec3};

/// A box between two corners.
pub type Corners = [Vec3; 2];

/// Triangles in a part, about.
const TRIANGLES: f32 = 128.0;

/// A surface has at most so many parts along a side.
const MAX_PER_SIDE: u32 = 32;

/// The boxes of a surface's parts, which together hold all its triangles: columns along its bounds'
/// shortest side, over squares of the other two. Each triangle is wholly in the part that its middle
/// is in. Parts without triangles are left out, and triangles that are not finite. All is in the
/// surface's own space.
///
/// Worked out bit by bit: all triangles are measured, then a grid is laid, then all are sorted in.
#[derive(Debug, Clone)]
pub struct PartBoxes {
    bounds: Corners,
    count: u32,
    grid: Option<Grid>,
    found: Vec<Corners>,
}

#[derive(Debug, Clone, Copy)]
struct Grid {
    /// Axes of its plane.
    sides: [usize; 2],
    start: Vec2,
    extent: Vec2,
    cells: UVec2,
}

impl Default for PartBoxes {
    fn default() -> Self {
        Self {
            bounds: NOTHING,
            count: 0,
            grid: None,
            found: Vec::new(),
        }
    }
}

impl PartBoxes {
    /// Takes a triangle into account.
    pub fn measure(&mut self, triangle: [Vec3; 3]) {
        if is_finite(&triangle) {
            self.bounds = grown(self.bounds, triangle);
            self.count = self.count.saturating_add(1);
        }
    }

    /// Ends measuring.
    pub fn lay_grid(&mut self) {
        let size = self.bounds[1] - self.bounds[0];
        let sides = if size.min_element() == size.y {
            [0, 2]
        } else if size.min_element() == size.x {
            [1, 2]
        } else {
            [0, 1]
        };
        let (start, extent) = (flat(sides, self.bounds[0]), flat(sides, size));
        let square = (extent.x * extent.y * TRIANGLES / self.count as f32).sqrt();
        let most = UVec2::splat(MAX_PER_SIDE);
        let cells = (extent / square).ceil().as_uvec2().clamp(UVec2::ONE, most);
        // A line or a point has no plane to lay it in.
        self.grid = (square > 0.0 && square.is_finite()).then_some(Grid {
            sides,
            start,
            extent,
            cells,
        });
        let parts = self.grid.map_or(1, |grid| grid.cells.x * grid.cells.y);
        self.found = vec![NOTHING; parts as usize];
    }

    /// Puts a triangle into the box of its part.
    pub fn sort_in(&mut self, triangle: [Vec3; 3]) {
        if !is_finite(&triangle) {
            return;
        }
        let index = self.grid.map_or(0, |grid| {
            let middle = flat(grid.sides, triangle.iter().sum::<Vec3>() / 3.0);
            let share = (middle - grid.start) / grid.extent;
            let cell = (share * grid.cells.as_vec2())
                .as_uvec2()
                .min(grid.cells - 1);
            cell.y * grid.cells.x + cell.x
        });
        let part = &mut self.found[index as usize];
        *part = grown(*part, triangle);
    }

    /// The boxes.
    pub fn finish(mut self) -> Vec<Corners> {
        self.found.retain(|part| *part != NOTHING);
        self.found
    }
}

const NOTHING: Corners = [Vec3::INFINITY, Vec3::NEG_INFINITY];

fn flat(sides: [usize; 2], point: Vec3) -> Vec2 {
    Vec2::new(point[sides[0]], point[sides[1]])
}

fn is_finite(triangle: &[Vec3; 3]) -> bool {
    triangle.iter().all(|corner| corner.is_finite())
}

fn grown([lo, hi]: Corners, triangle: [Vec3; 3]) -> Corners {
    triangle.iter().fold([lo, hi], |[lo, hi], corner| {
        [lo.min(*corner), hi.max(*corner)]
    })
}
