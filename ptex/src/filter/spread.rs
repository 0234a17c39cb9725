//! A kernel laid over the faces that it reaches: cut at edges, turned from frame to frame, moved between faces and
//! sub-faces.
//!
//! Burley and Lacewell 2008, section 5: a kernel is a rectangle of separable weights on the grid of one face. What
//! reaches past the right or left edge is cut off first, and of that, what reaches past the top or bottom as well: the
//! corners. Every piece goes on in the frame of the face beyond. A polygon that is not a quad is stored as one sub-face
//! for each of its corners, half as long and wide as a face: an edge of a face meets two of them, and on the way the
//! kernel's grid halves or doubles.
//!
//! ```text
//!            2 (top)                       edge of a face     |           |
//!      3 +-----------+ 2                   ------------------ +-----------+-----------
//!        |           |                     first sub-face     |   first   |  second
//! 3      |   face    |  1 (right)          met counter-       | sub-face  | sub-face
//! (left) |           |                     clockwise along    |           |
//!      0 +-----------+ 1                   the edge           |           |
//!           0 (bottom)
//! ```
//!
//! Files lie: adjacency may lead in circles. What cannot be placed, or takes more than [`MAX_STEPS`] steps, is left
//! out, and its weight is missing in the sum that the result is divided by. So it goes with corners of three faces.

use super::Target;
use super::kernel::Taps;
use crate::error::Result;
use crate::types::{BorderMode, EdgeFilter, FaceInfo, Res};

/// Edges and corners that one kernel may pass. Around a sub-face the widest kernel passes about 30, and twice as many at
/// vertices where ten faces meet.
const MAX_STEPS: u32 = 1000;

/// Separable weights on the grid of a face, and by how many quarter turns that face's frame is turned against the one
/// where the kernel was laid first.
#[derive(Clone, Copy)]
pub(super) struct Kernel {
    pub(super) u: Taps,
    pub(super) v: Taps,
    turns: i32,
}

impl Kernel {
    pub(super) fn new(u: Taps, v: Taps) -> Self {
        Self { u, v, turns: 0 }
    }

    #[inline]
    pub(super) fn weight(&self) -> f32 {
        self.u.sum() * self.v.sum()
    }

    /// The axis across an edge.
    fn across(&self, edge: usize) -> &Taps {
        if edge & 1 == 0 { &self.v } else { &self.u }
    }

    fn across_mut(&mut self, edge: usize) -> &mut Taps {
        if edge & 1 == 0 {
            &mut self.v
        } else {
            &mut self.u
        }
    }

    /// Whether it reaches past an edge.
    #[inline]
    fn passes(&self, edge: usize) -> bool {
        if far(edge) {
            self.across(edge).above()
        } else {
            self.across(edge).below()
        }
    }

    /// Cuts off what is past an edge.
    fn cut(&mut self, edge: usize) -> Self {
        let mut piece = *self;
        let taps = self.across_mut(edge);
        *piece.across_mut(edge) = if far(edge) {
            taps.cut_above()
        } else {
            taps.cut_below()
        };
        piece
    }

    /// Treats what is past an edge as the border mode says. Returns the weight that falls into the dark.
    fn fold(&mut self, edge: usize, modes: [BorderMode; 2]) -> f32 {
        let piece = self.cut(edge);
        let taps = self.across_mut(edge);
        match modes[1 - (edge & 1)] {
            BorderMode::Black => return piece.weight(),
            BorderMode::Clamp | BorderMode::Periodic if far(edge) => {
                taps.fold_above(piece.across(edge));
            }
            BorderMode::Clamp | BorderMode::Periodic => taps.fold_below(piece.across(edge)),
        }
        0.0
    }

    /// Turns it counter-clockwise by quarters.
    pub(super) fn turn(&mut self, quarters: i32) {
        let quarters = quarters & 3;
        self.turns += quarters;
        match quarters {
            1 => self.u.mirror(),
            2 => {
                self.u.mirror();
                self.v.mirror();
            }
            3 => self.v.mirror(),
            _ => {}
        }
        if quarters & 1 == 1 {
            std::mem::swap(&mut self.u, &mut self.v);
        }
    }

    /// From beyond edge `edge` of a face to the first of the sub-faces there, or else, by `false`, to the second. The
    /// kernel is in the face's frame still.
    pub(super) fn enter_subface(&mut self, edge: i32) -> bool {
        self.u.onto_half();
        self.v.onto_half();
        let (u, v) = (self.u.size(), self.v.size());
        match edge & 3 {
            0 => {
                self.v.at -= v;
                let first = self.u.at < u;
                if !first {
                    self.u.at -= u;
                }
                first
            }
            1 => {
                let first = self.v.at < v;
                if !first {
                    self.v.at -= v;
                }
                first
            }
            2 => {
                let first = self.u.at >= u;
                if first {
                    self.u.at -= u;
                }
                first
            }
            _ => {
                self.u.at -= u;
                let first = self.v.at >= v;
                if first {
                    self.v.at -= v;
                }
                first
            }
        }
    }

    /// From beyond an edge of a sub-face to the face there, which is twice as large.
    pub(super) fn leave_subface(&mut self, edge: i32) {
        let edge = edge & 3;
        if edge >= 2 {
            self.u.at += self.u.size();
        }
        if edge == 0 || edge == 3 {
            self.v.at += self.v.size();
        }
        self.u.onto_double();
        self.v.onto_double();
    }
}

/// Whether an edge is where its axis ends, not where it begins.
fn far(edge: usize) -> bool {
    edge == 1 || edge == 2
}

/// A lookup under way: where texels go, and the sum of the weights that they go with.
pub(super) struct Spread<'a, 't> {
    target: &'a mut Target<'t>,
    weight: f32,
    steps: u32,
    modes: [BorderMode; 2],
}

impl<'a, 't> Spread<'a, 't> {
    pub(super) fn new(target: &'a mut Target<'t>) -> Self {
        let modes = target.reader.border_modes();
        Self {
            target,
            weight: 0.0,
            steps: 0,
            modes: [modes.0, modes.1],
        }
    }

    /// Lays a kernel over a face, and with `edge_blend` over all that it reaches. Returns the weight of what was added.
    pub(super) fn start(mut self, mut kernel: Kernel, face: u32, edge_blend: bool) -> Result<f32> {
        if edge_blend {
            self.lay(&mut kernel, face)?;
        } else {
            for edge in 0..4 {
                if kernel.passes(edge) {
                    self.weight += kernel.fold(edge, self.modes);
                }
            }
            self.add(&mut kernel, face)?;
        }
        Ok(self.weight)
    }

    /// Lays a kernel over a face and, where it passes the face's edges, on over others.
    pub(super) fn lay(&mut self, kernel: &mut Kernel, face: u32) -> Result<()> {
        if (0..4).any(|edge| kernel.passes(edge)) {
            let info = *self.face(face);
            for (edge, corners) in [(1, [(2, 2), (0, 1)]), (3, [(2, 3), (0, 0)])] {
                let Some(mut piece) = self.cut(kernel, &info, edge) else {
                    continue;
                };
                for (side, corner) in corners {
                    if let Some(piece) = self.cut(&mut piece, &info, side) {
                        self.across_corner(piece, face, corner)?;
                    }
                }
                self.across_edge(piece, face, edge)?;
            }
            for edge in [2, 0] {
                if let Some(piece) = self.cut(kernel, &info, edge) {
                    self.across_edge(piece, face, edge)?;
                }
            }
        }
        self.add(kernel, face)
    }

    /// What has to go on beyond an edge.
    fn cut(&mut self, kernel: &mut Kernel, info: &FaceInfo, edge: usize) -> Option<Kernel> {
        if !kernel.passes(edge) {
            return None;
        }
        if info.neighbours[edge].is_none() {
            self.weight += kernel.fold(edge, self.modes);
            return None;
        }
        Some(kernel.cut(edge))
    }

    fn across_edge(&mut self, mut kernel: Kernel, face: u32, edge: usize) -> Result<()> {
        let from = self.face(face);
        let Some(next) = from.neighbours[edge] else {
            return Ok(());
        };
        let mut to = next.face;
        let mut turns = edge as i32 - i32::from(next.edge) + 2;
        let (is_subface, goes_to_subface) = (from.subface, self.face(to).subface);
        if goes_to_subface && !is_subface {
            if !kernel.enter_subface(edge as i32) {
                let beside = usize::from(next.edge + 3) & 3;
                let Some(second) = self.face(to).neighbours[beside] else {
                    return Ok(());
                };
                to = second.face;
                turns += beside as i32 - i32::from(second.edge) + 2;
            }
        } else if is_subface && !goes_to_subface {
            let named = self.face(to).neighbours[usize::from(next.edge)];
            let first = named.is_some_and(|named| named.face == face);
            kernel.leave_subface(edge as i32 - i32::from(first));
        }
        kernel.turn(turns);
        self.place(kernel, to)
    }

    /// Puts a piece on the face that it was moved to: on a sub-face it may reach further.
    pub(super) fn place(&mut self, mut kernel: Kernel, face: u32) -> Result<()> {
        if !self.step() {
            Ok(())
        } else if self.face(face).subface {
            self.lay(&mut kernel, face)
        } else {
            self.add(&mut kernel, face)
        }
    }

    /// Takes a step, if there is one left.
    pub(super) fn step(&mut self) -> bool {
        self.steps += 1;
        self.steps <= MAX_STEPS
    }

    #[inline]
    pub(super) fn face(&self, face: u32) -> &'t FaceInfo {
        self.target.reader.face(face)
    }

    /// Adds the texels of one face.
    fn add(&mut self, kernel: &mut Kernel, face: u32) -> Result<()> {
        // Only where adjacency contradicts itself does anything reach out of the face now.
        for edge in 0..4 {
            if kernel.passes(edge) {
                kernel.fold(edge, [BorderMode::Clamp; 2]);
            }
        }
        if kernel.u.is_empty() || kernel.v.is_empty() {
            return Ok(());
        }
        self.weight += kernel.weight();
        let reader = self.target.reader;
        let full = reader.face(face).res;
        kernel.u.reduce_to(full.ulog2);
        kernel.v.reduce_to(full.vlog2);
        let res = Res {
            ulog2: kernel.u.log2,
            vlog2: kernel.v.log2,
        };
        let texels = reader.texels(face, res, self.target.premultiply)?;
        let (first, out) = (self.target.first_channel, &mut *self.target.out);
        let add = |first, out: &mut [f32]| {
            texels.add_weighted(
                kernel.u.at as usize,
                kernel.v.at as usize,
                kernel.u.weights(),
                kernel.v.weights(),
                1.0,
                first,
                out,
            )
        };
        let turns = kernel.turns & 3;
        let turned =
            turns != 0 && out.len() >= 2 && reader.edge_filter() == EdgeFilter::TangentVector;
        if !turned || texels.constant() {
            return add(first, out);
        }
        let mut vector = [0.0; 2];
        add(first, &mut vector)?;
        let (x, y) = (vector[0], vector[1]);
        let (x, y) = [(x, y), (-y, x), (-x, -y), (y, -x)][turns as usize];
        out[0] += x;
        out[1] += y;
        if out.len() > 2 {
            add(first + 2, &mut out[2..])?;
        }
        Ok(())
    }
}
