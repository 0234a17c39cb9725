//! What lies across a vertex.
//!
//! Burley and Lacewell 2008, section 5.2 on extraordinary vertices: the faces around a vertex are met by walking
//! around it. With four, the one opposite takes the piece of the kernel that passes both edges. With three there is no
//! room for it. With five or more each of those opposite takes a copy, made symmetric since there is no telling which
//! axis is which.

use super::spread::{Kernel, Spread};
use crate::error::Result;

/// Steps of a walk. Around vertices of more faces no face counts as opposite.
const MAX_WALK: usize = 10;

/// A face on a walk around a vertex, and the edge by which it is left.
#[derive(Clone, Copy, Default, PartialEq)]
struct Met {
    face: u32,
    leaves_by: usize,
}

impl Spread<'_, '_> {
    /// Places what passes both edges at a corner of a face. Corner `c` is where edge `c` begins, and where the walk,
    /// which is clockwise, goes first.
    pub(super) fn across_corner(&mut self, kernel: Kernel, face: u32, corner: usize) -> Result<()> {
        let start = Met {
            face,
            leaves_by: corner,
        };
        let mut met = [Met::default(); MAX_WALK];
        let mut count = 0;
        let mut at = start;
        let closed = loop {
            let Some(next) = self.face(at.face).neighbours[at.leaves_by] else {
                break true;
            };
            let before = at.face;
            at = Met {
                face: next.face,
                leaves_by: usize::from(next.edge + 1) & 3,
            };
            if at == start {
                break true;
            }
            let named = self.face(at.face).neighbours[(at.leaves_by + 3) & 3];
            if self.face(before).subface
                && !self.face(at.face).subface
                && named.is_some_and(|named| named.face == before)
            {
                return self.on_side(kernel, corner as i32, at, i32::from(count == 1));
            }
            met[count] = at;
            count += 1;
            if count == MAX_WALK {
                break false;
            }
        };
        // The first and the last have an edge in common with the face.
        let opposite = if closed && count > 2 {
            &met[1..count - 1]
        } else {
            &[]
        };
        let subface = self.face(face).subface;
        match opposite {
            [] => Ok(()),
            [one] => self.opposite(kernel, subface, corner as i32, *one),
            many => {
                let copy = symmetric(kernel, corner as i32);
                for one in many {
                    self.opposite(copy, subface, 2, *one)?;
                }
                Ok(())
            }
        }
    }

    /// The vertex lies amid an edge of a face, with two sub-faces on this side: the face has all that is across it.
    /// `second`: it is the second that was met.
    fn on_side(&mut self, mut kernel: Kernel, corner: i32, face: Met, second: i32) -> Result<()> {
        kernel.leave_subface(corner + 2 * second);
        kernel.turn(corner - face.leaves_by as i32 + 3 - second);
        if self.step() {
            self.lay(&mut kernel, face.face)
        } else {
            Ok(())
        }
    }

    fn opposite(
        &mut self,
        mut kernel: Kernel,
        from_subface: bool,
        corner: i32,
        to: Met,
    ) -> Result<()> {
        match (from_subface, self.face(to.face).subface) {
            (false, true) => {
                kernel.enter_subface(corner + 3);
            }
            (true, false) => kernel.leave_subface(corner + 3),
            _ => {}
        }
        kernel.turn(corner - to.leaves_by as i32 + 2);
        self.place(kernel, to.face)
    }
}

/// A piece past corner 2, made from one past any corner, that is the same in u and v. It weighs what the piece does,
/// unless it would have to be enlarged for that.
fn symmetric(mut kernel: Kernel, corner: i32) -> Kernel {
    let before = kernel.weight();
    kernel.turn(corner + 2);
    let log2 = kernel.u.log2.min(kernel.v.log2);
    kernel.u.reduce_to(log2);
    kernel.v.reduce_to(log2);
    kernel.u = kernel.u.merged(&kernel.v);
    kernel.v = kernel.u;
    // Kernels that sharpen have pieces of negative weight, and of nearly none.
    let scale = before / kernel.weight();
    if (-1.0..1.0).contains(&scale) {
        kernel.u.multiply(scale);
    } else if scale < -1.0 {
        kernel.u.multiply(-1.0);
    }
    kernel
}
