//! A leaf by itself: the clear twin of what [`traverse`](super::traverse) does with all leaves of a tile at once.

use super::tile::{CUTS, Tile};
use crate::accel::moment::Moment;
use crate::math::{Vec2, Vec3};

/// A leaf's slab, in the coordinates of its tile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Leaf {
    /// Where u, v and h are zero on the lattice, and how they grow along its axes.
    origin: Vec3,
    pub(super) axes: [Vec3; 3],
    /// Heights of the corners (0, 0), (1, 0), (0, 1) and (1, 1).
    pub(super) corners: [f32; 4],
    /// Its quads in u and v: the first one, and the one after the last.
    pub(super) first: Vec2,
    pub(super) last: Vec2,
    /// Where it begins and ends in u and v.
    pub(super) from: Vec2,
    pub(super) to: Vec2,
    /// How far the surface may be below the plane, and above.
    pub(super) below: f32,
    pub(super) above: f32,
}

impl Leaf {
    /// A leaf of a tile of so many quads.
    #[inline(always)]
    pub(super) fn of(tile: &Tile, leaf: usize, quads: [usize; 2]) -> Self {
        let cuts = [0, 1].map(|k| &CUTS[k][quads[k]]);
        let wider = |side: usize| Vec2::from([0, 1].map(|k| tile.side(side, k, leaf)));
        let first = Vec2::from(cuts.map(|cuts| cuts.first[leaf]));
        let last = Vec2::from(cuts.map(|cuts| cuts.last[leaf]));
        Self {
            origin: Vec3::from(tile.origin()),
            axes: tile.axes().map(Vec3::from),
            corners: tile.corners().map(|corners| corners[leaf].into()),
            first,
            last,
            from: first + wider(0),
            to: last + wider(1),
            below: tile.depth(0, leaf),
            above: tile.depth(1, leaf),
        }
    }

    /// On the way from one motion key to the next.
    #[inline(always)]
    pub(super) fn on_the_way(&self, to: &Self, moment: &Moment) -> Self {
        let [a, b] = moment.weights;
        let blend = |from: f32, to: f32| a * from + b * to;
        Self {
            origin: moment.between(self.origin, to.origin),
            corners: std::array::from_fn(|k| blend(self.corners[k], to.corners[k])),
            from: a * self.from + b * to.from,
            to: a * self.to + b * to.to,
            below: blend(self.below, to.below),
            above: blend(self.above, to.above),
            ..*self
        }
    }

    /// u, v and h of a point on the lattice.
    #[inline(always)]
    pub(super) fn place(&self, p: Vec3) -> Vec3 {
        Vec3::from(self.axes.map(|axis| axis.dot(p - self.origin)))
    }

    /// The plane's normal on the lattice: as long as the height above it grows along it.
    #[inline(always)]
    pub(super) fn normal(&self) -> Vec3 {
        let slopes = self.slopes();
        self.axes[2] - slopes.x * self.axes[0] - slopes.y * self.axes[1]
    }

    /// Quads before a place, counted within the tile.
    #[inline(always)]
    pub(super) fn quads(&self, uv: Vec2) -> Vec2 {
        let part = (uv - self.from) / (self.to - self.from);
        let part = if part.is_finite() {
            part
        } else {
            Vec2::splat(0.5)
        };
        self.first + part.clamp(Vec2::ZERO, Vec2::ONE) * (self.last - self.first)
    }

    /// How the plane's height grows along u and v.
    #[inline(always)]
    pub(super) fn slopes(&self) -> Vec2 {
        let [a, b, c, d] = self.corners;
        0.5 * Vec2::new(b + d - a - c, c + d - a - b) / (self.last - self.first)
    }
}
