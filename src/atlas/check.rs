//! Whether a chart is mapped one to one: no triangle is turned over, and the border does not meet itself.
//!
//! That is enough: where all triangles keep their side, each point of the plane is covered as often as the border winds
//! around it, and a border without crossings winds around a point once or not at all.

use robust::{Coord, orient2d};

use super::cage::Cage;
use super::chart::{Disk, Flat};
use crate::math::DVec2;

/// How much of its length a side of a triangle keeps at least that counts only for a face's convexity.
const CONVEX: f64 = 1e-3;

/// Whether lengths become at most `most` times as long or short, beside what they do all over the chart, and the chart
/// is mapped one to one.
pub(super) fn is_good(cage: &Cage, disk: &Disk, places: &[DVec2], most: f64) -> bool {
    for (face, nodes) in disk.face_nodes() {
        for triangle in cage.triangles(face) {
            let to = triangle.corners.map(|i| places[nodes[i as usize] as usize]);
            let [greatest, least] = triangle.stretch(to);
            let allowed = match triangle.weight > 0.0 {
                true => greatest <= most && least >= most.recip(),
                false => least >= CONVEX,
            };
            // NaN is not allowed either.
            if !allowed {
                return false;
            }
        }
    }
    is_simple(&outline(disk, places))
}

/// Whether that is so of places that were rounded, and of the polygons that stand in for faces.
pub(super) fn is_one_to_one(
    cage: &Cage,
    chart: &Flat,
    places: &[DVec2],
    left_handed: bool,
) -> bool {
    let turn = if left_handed { -1.0 } else { 1.0 };
    let turned = |(face, nodes): (u32, &[u32])| {
        let at = |i: u32| places[nodes[i as usize] as usize];
        let n = nodes.len() as u32;
        if chart.stands_in {
            return (0..n).any(|i| turn * side([i, (i + 1) % n, (i + 2) % n].map(at)) <= 0.0);
        }
        let mut shapes = cage.triangles(face).iter().filter(|t| t.weight > 0.0);
        shapes.any(|t| side(t.corners.map(at)) <= 0.0)
    };
    let disk = &chart.disk;
    !disk.face_nodes().any(turned) && is_simple(&outline(disk, places))
}

/// The border without places that follow themselves.
fn outline(disk: &Disk, places: &[DVec2]) -> Vec<DVec2> {
    let mut outline: Vec<DVec2> = disk.border.iter().map(|&n| places[n as usize]).collect();
    outline.dedup();
    while outline.len() > 1 && outline.first() == outline.last() {
        outline.pop();
    }
    outline
}

/// Above 0 where three points run counterclockwise; exact.
fn side(points: [DVec2; 3]) -> f64 {
    let [a, b, c] = points.map(|p| Coord { x: p.x, y: p.y });
    orient2d(a, b, c)
}

/// Whether a closed polygon does not meet itself.
pub(super) fn is_simple(outline: &[DVec2]) -> bool {
    let n = outline.len();
    if n < 3 {
        return false;
    }
    struct Segment {
        number: usize,
        ends: [DVec2; 2],
    }
    let mut segments: Vec<Segment> = (0..n)
        .map(|number| {
            let (a, b) = (outline[number], outline[(number + 1) % n]);
            let ends = if a.x <= b.x { [a, b] } else { [b, a] };
            Segment { number, ends }
        })
        .collect();
    segments.sort_by(|a, b| {
        let by_start = a.ends[0].x.total_cmp(&b.ends[0].x);
        by_start.then(a.number.cmp(&b.number))
    });
    // Those that a line that runs over the polygon along x has met and not left.
    let mut met: Vec<&Segment> = Vec::new();
    for segment in &segments {
        met.retain(|other| other.ends[1].x >= segment.ends[0].x);
        for other in &met {
            let apart = segment.number.abs_diff(other.number);
            let adjacent = apart == 1 || apart == n - 1;
            if adjacent && n > 3 && folds(outline, segment.number, other.number) {
                return false;
            }
            if !adjacent && meet(segment.ends, other.ends) {
                return false;
            }
        }
        met.push(segment);
    }
    true
}

/// Whether two segments that share a point lie on each other.
fn folds(outline: &[DVec2], a: usize, b: usize) -> bool {
    let n = outline.len();
    let first = if (a + 1) % n == b { a } else { b };
    let [p, q, r] = [0, 1, 2].map(|i| outline[(first + i) % n]);
    side([p, q, r]) == 0.0 && (p - q).dot(r - q) > 0.0
}

/// Whether two segments have a point in common.
fn meet([a, b]: [DVec2; 2], [c, d]: [DVec2; 2]) -> bool {
    let apart = a.max(b).cmplt(c.min(d)).any() || c.max(d).cmplt(a.min(b)).any();
    if apart {
        return false;
    }
    let sign = |x: f64| (x > 0.0) as i32 - (x < 0.0) as i32;
    let sides = [[a, b, c], [a, b, d], [c, d, a], [c, d, b]].map(|t| sign(side(t)));
    // With boxes that meet, four points on one line do, too.
    sides[0] * sides[1] <= 0 && sides[2] * sides[3] <= 0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn polygon(points: &[(f64, f64)]) -> Vec<DVec2> {
        points.iter().map(|&(x, y)| DVec2::new(x, y)).collect()
    }

    #[test]
    fn an_l_is_simple_and_what_crosses_or_touches_itself_is_not() {
        let l = [(0., 0.), (2., 0.), (2., 1.), (1., 1.), (1., 2.), (0., 2.)];
        assert!(is_simple(&polygon(&l)));
        assert!(!is_simple(&polygon(&[
            (0., 0.),
            (1., 1.),
            (1., 0.),
            (0., 1.)
        ])));
        // A point on another edge, and a way back.
        let touching = [(0., 0.), (2., 0.), (2., 2.), (1., 0.), (0., 2.)];
        assert!(!is_simple(&polygon(&touching)));
        assert!(!is_simple(&polygon(&[
            (0., 0.),
            (2., 0.),
            (1., 0.),
            (1., 1.)
        ])));
    }
}
