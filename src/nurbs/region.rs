//! A part of the parameter plane bounded by closed polygons, and cuts through it parallel to the axes.
//!
//! A point belongs to the region if the polygons wind around it an odd number of times. A cut divides each polygon
//! that it meets into chains on either side. Along the cut, a point is inside between the first and the second
//! crossing, the third and the fourth, and so on; these stretches of the cut link the chains to polygons again. Both
//! sides get the same crossings to the bit, so parts that were cut apart still fit together.
//!
//! Polygons may touch and cross each other or themselves: cuts stay right; only the triangles of a part that holds such
//! a crossing are then approximate.

use earcut::Earcut;

/// A region; without polygons it is empty.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Region {
    polygons: Vec<Polygon>,
}

type Polygon = Vec<[f64; 2]>;

/// A stretch of a polygon on one side of a cut, both ends on the cut.
struct Chain(Vec<[f64; 2]>);

impl Region {
    /// What the polygons wind around an odd number of times.
    pub fn new(polygons: Vec<Vec<[f64; 2]>>) -> Self {
        let polygons = polygons.into_iter().filter(|p| p.len() >= 3).collect();
        Self { polygons }
    }

    /// Whether it is empty.
    pub fn is_empty(&self) -> bool {
        self.polygons.is_empty()
    }

    /// The polygons that bound it.
    pub fn polygons(&self) -> &[Vec<[f64; 2]>] {
        &self.polygons
    }

    /// Whether it is all of the rectangle from `low` to `high`, given that it does not reach out of it.
    pub fn fills(&self, low: [f64; 2], high: [f64; 2]) -> bool {
        let [polygon] = self.polygons.as_slice() else {
            return false;
        };
        polygon.len() >= 4
            && polygon.iter().all(|p| {
                (p[0] == low[0] || p[0] == high[0]) && (low[1]..=high[1]).contains(&p[1])
                    || (p[1] == low[1] || p[1] == high[1]) && (low[0]..=high[0]).contains(&p[0])
            })
            && {
                let whole = (high[0] - low[0]) * (high[1] - low[1]);
                (area(polygon).abs() - whole).abs() <= 1e-12 * whole
            }
    }

    /// Cuts at `u = at` (`axis` 0) or `v = at` (1): the part below and the part above.
    pub fn cut(&self, axis: usize, at: f64) -> [Self; 2] {
        let mut parts = [Self::default(), Self::default()];
        let mut chains: [Vec<Chain>; 2] = [Vec::new(), Vec::new()];
        for polygon in &self.polygons {
            let side = |p: &[f64; 2]| usize::from(p[axis] >= at);
            let first = side(&polygon[0]);
            if polygon.iter().all(|p| side(p) == first) {
                parts[first].polygons.push(polygon.clone());
                continue;
            }
            // From the first change of sides once around.
            let n = polygon.len();
            let start = (0..n)
                .find(|&i| side(&polygon[i]) != side(&polygon[(i + 1) % n]))
                .unwrap_or(0);
            let mut chain = Vec::new();
            for i in start..start + n {
                let (a, b) = (&polygon[i % n], &polygon[(i + 1) % n]);
                if side(a) != side(b) {
                    let crossing = crossing(*a, *b, axis, at);
                    if i > start {
                        chain.push(crossing);
                        chains[side(a)].push(Chain(std::mem::take(&mut chain)));
                    }
                    chain.push(crossing);
                }
                chain.push(*b);
            }
            // Back at the first crossing; its far point was the start of the loop above.
            let (a, b) = (&polygon[start], &polygon[(start + 1) % n]);
            chain.push(crossing(*a, *b, axis, at));
            chains[side(a)].push(Chain(chain));
        }
        for (part, chains) in parts.iter_mut().zip(chains) {
            part.polygons.extend(linked(chains, axis));
        }
        parts
    }

    /// Triangles that fill the region: their corners, by number, and the corners' places.
    pub fn triangles(&self) -> (Vec<[u32; 3]>, Vec<[f64; 2]>) {
        let mut triangles = Vec::new();
        let mut places: Vec<[f64; 2]> = Vec::new();
        let mut earcut = Earcut::new();
        let mut local: Vec<u32> = Vec::new();
        let depths: Vec<usize> = (0..self.polygons.len()).map(|i| self.depth(i)).collect();
        for (i, outline) in self.polygons.iter().enumerate() {
            if depths[i] % 2 == 1 {
                continue;
            }
            let base = places.len() as u32;
            places.extend(outline);
            let mut holes = Vec::new();
            for (j, hole) in self.polygons.iter().enumerate() {
                if depths[j] == depths[i] + 1 && contains(outline, middle(hole)) {
                    holes.push(places.len() as u32 - base);
                    places.extend(hole);
                }
            }
            earcut.earcut(places[base as usize..].iter().copied(), &holes, &mut local);
            let counterclockwise = |t: [u32; 3]| {
                let [a, b, c] = t.map(|k| places[k as usize]);
                if area(&[a, b, c]) < 0.0 {
                    [t[0], t[2], t[1]]
                } else {
                    t
                }
            };
            triangles.extend(
                local
                    .as_chunks::<3>()
                    .0
                    .iter()
                    .map(|t| counterclockwise(t.map(|k| base + k))),
            );
        }
        (triangles, places)
    }

    /// How many of the other polygons a polygon lies in.
    fn depth(&self, polygon: usize) -> usize {
        let inside = middle(&self.polygons[polygon]);
        let others = self.polygons.iter().enumerate();
        others
            .filter(|&(i, other)| i != polygon && contains(other, inside))
            .count()
    }
}

/// The signed area: above 0 where the polygon runs counterclockwise.
fn area(polygon: &[[f64; 2]]) -> f64 {
    let origin = polygon[0];
    let mut sum = 0.0;
    for pair in polygon.windows(2) {
        let [a, b] = [0, 1].map(|k| [pair[k][0] - origin[0], pair[k][1] - origin[1]]);
        sum += a[0] * b[1] - a[1] * b[0];
    }
    0.5 * sum
}

/// A point on the polygon's boundary that is not one of its corners, which other polygons may share.
fn middle(polygon: &[[f64; 2]]) -> [f64; 2] {
    let longest = (0..polygon.len())
        .map(|i| (polygon[i], polygon[(i + 1) % polygon.len()]))
        .max_by(|x, y| length(*x).total_cmp(&length(*y)));
    longest.map_or(polygon[0], |(a, b)| {
        [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])]
    })
}

fn length((a, b): ([f64; 2], [f64; 2])) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Whether a point is inside of a polygon by odd crossings.
fn contains(polygon: &[[f64; 2]], [u, v]: [f64; 2]) -> bool {
    let mut inside = false;
    for i in 0..polygon.len() {
        let (a, b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
        if (a[1] <= v) != (b[1] <= v) && crossing(a, b, 1, v)[0] > u {
            inside = !inside;
        }
    }
    inside
}

fn crossing(a: [f64; 2], b: [f64; 2], axis: usize, at: f64) -> [f64; 2] {
    let t = (at - a[axis]) / (b[axis] - a[axis]);
    let other = 1 - axis;
    let mut out = [at; 2];
    // Never beyond the edge's ends, so that parts stay within the rectangle that was cut out.
    let (low, high) = (a[other].min(b[other]), a[other].max(b[other]));
    out[other] = ((1.0 - t) * a[other] + t * b[other]).clamp(low, high);
    out
}

/// Chains on one side of a cut as closed polygons.
fn linked(mut chains: Vec<Chain>, axis: usize) -> Vec<Polygon> {
    // Ends along the cut: chain, and whether it is its last point.
    let mut ends: Vec<(usize, bool)> = (0..chains.len())
        .flat_map(|i| [(i, false), (i, true)])
        .collect();
    let along = |&(i, last): &(usize, bool)| {
        let Chain(points) = &chains[i];
        points[if last { points.len() - 1 } else { 0 }][1 - axis]
    };
    ends.sort_by(|a, b| along(a).total_cmp(&along(b)));
    let mut partner = vec![[(0, false); 2]; chains.len()];
    for pair in ends.as_chunks::<2>().0 {
        let [a, b] = *pair;
        partner[a.0][usize::from(a.1)] = b;
        partner[b.0][usize::from(b.1)] = a;
    }
    let mut polygons = Vec::new();
    for i in 0..chains.len() {
        let mut polygon: Polygon = Vec::new();
        let (mut at, mut from_last) = (i, false);
        // Each chain is taken once: an empty one was.
        while !chains[at].0.is_empty() {
            let mut points = std::mem::take(&mut chains[at].0);
            if from_last {
                points.reverse();
            }
            polygon.extend(points);
            // On from the end that was not come in by.
            (at, from_last) = partner[at][usize::from(!from_last)];
        }
        polygon.dedup();
        if polygon.first() == polygon.last() {
            polygon.pop();
        }
        if polygon.len() >= 3 {
            polygons.push(polygon);
        }
    }
    polygons
}
