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
pub fn part_boxes<I: Iterator<Item = [Vec3; 3]>>(triangles: impl Fn() -> I) -> Vec<Corners> {
    let finite = || triangles().filter(is_finite);
    let (mut bounds, mut count) = (NOTHING, 0);
    for triangle in finite() {
        bounds = grown(bounds, triangle);
        count += 1;
    }
    let grid = Grid::new(bounds, count);
    let parts = grid.as_ref().map_or(1, Grid::parts);
    let mut found = vec![NOTHING; parts];
    for triangle in finite() {
        let part = &mut found[grid.as_ref().map_or(0, |grid| grid.part_of(&triangle))];
        *part = grown(*part, triangle);
    }
    found.retain(|part| *part != NOTHING);
    found
}

struct Grid {
    /// Axes of its plane.
    sides: [usize; 2],
    start: Vec2,
    extent: Vec2,
    cells: UVec2,
}

impl Grid {
    /// `None` over a line or a point, which have no plane to lay it in.
    fn new(bounds: Corners, count: usize) -> Option<Self> {
        let size = bounds[1] - bounds[0];
        let sides = if size.min_element() == size.y {
            [0, 2]
        } else if size.min_element() == size.x {
            [1, 2]
        } else {
            [0, 1]
        };
        let (start, extent) = (flat(sides, bounds[0]), flat(sides, size));
        let square = (extent.x * extent.y * TRIANGLES / count as f32).sqrt();
        let most = UVec2::splat(MAX_PER_SIDE);
        let cells = (extent / square).ceil().as_uvec2().clamp(UVec2::ONE, most);
        (square > 0.0 && square.is_finite()).then_some(Self {
            sides,
            start,
            extent,
            cells,
        })
    }

    fn parts(&self) -> usize {
        (self.cells.x * self.cells.y) as usize
    }

    fn part_of(&self, triangle: &[Vec3; 3]) -> usize {
        let middle = flat(self.sides, triangle.iter().sum::<Vec3>() / 3.0);
        let share = (middle - self.start) / self.extent;
        let cell = (share * self.cells.as_vec2())
            .as_uvec2()
            .min(self.cells - 1);
        (cell.y * self.cells.x + cell.x) as usize
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
