//! Charts into a square, after section 4 of the paper (see [`conformal`](super::conformal)): as when bricks fall, each
//! chart, the tallest first, comes to lie where its top is lowest on the horizon of those that lie already.
//!
//! Horizon and charts are columns of cells, at most [`CELLS`] of them across. The scale is the same for all charts, and
//! as large as fits. Departures from the paper: charts stand upright in the smallest rectangle around them, not along
//! their longest diameter, so that those with right angles fill their place.

use super::chart::Flat;
use crate::math::DVec2;

/// The most cells across.
const CELLS: u32 = 1024;
/// Scales that are tried between the smallest that is too large and half of it.
const STEPS: u32 = 10;
/// How often the scale is halved at most.
const HALVINGS: u32 = 40;
/// Cells that a polygon is wide at least that stands in for a face.
const LEAST: f64 = 1.0;

/// The square, in cells.
pub(super) struct Square {
    /// Across and up.
    cells: usize,
    /// Between charts, and half of it along the sides of the square.
    margin: usize,
}

/// Where a chart lies: its places times `scale`, plus `offset`, in units of the square.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    /// Times this.
    pub(super) scale: f64,
    /// Plus this.
    pub(super) offset: DVec2,
}

impl Square {
    /// For pictures of `resolution` texels across, with at least `margin` texels between charts.
    pub(super) fn new(resolution: u32, margin: f64) -> Self {
        let cells = resolution.min(CELLS);
        Self {
            cells: cells as usize,
            margin: (margin * f64::from(cells) / f64::from(resolution)).ceil() as usize,
        }
    }

    /// Turns charts upright and gives each a place; none if they do not fit, however small.
    pub(super) fn pack(&self, charts: &mut [Flat]) -> Option<Vec<Place>> {
        let mut sizes = Vec::with_capacity(charts.len());
        for chart in charts.iter_mut() {
            sizes.push(stand_upright(&mut chart.places));
        }
        let area: f64 = sizes.iter().map(|size| size.x * size.y).sum();
        let inner = self.cells.checked_sub(self.margin.max(1))?;
        // As if rectangles filled all of it.
        let mut large = inner as f64 / area.sqrt().max(f64::MIN_POSITIVE);
        if !large.is_finite() {
            large = 1.0;
        }
        let mut found = None;
        for _ in 0..HALVINGS {
            found = self.try_scale(charts, &sizes, large);
            if found.is_some() {
                break;
            }
            large *= 0.5;
        }
        let mut found = found?;
        let (mut fits, mut too_large) = (large, 2.0 * large);
        for _ in 0..STEPS {
            let middle = 0.5 * (fits + too_large);
            match self.try_scale(charts, &sizes, middle) {
                Some(places) => (found, fits) = (places, middle),
                None => too_large = middle,
            }
        }
        Some(found)
    }

    fn try_scale(&self, charts: &[Flat], sizes: &[DVec2], scale: f64) -> Option<Vec<Place>> {
        let own = |i: usize| match charts[i].stands_in {
            true if sizes[i].max_element() > 0.0 => {
                scale.max(LEAST / sizes[i].min_element().max(f64::MIN_POSITIVE))
            }
            _ => scale,
        };
        let side = self.cells.checked_sub(self.margin)?;
        let mut order: Vec<usize> = (0..charts.len()).collect();
        order.sort_by(|&a, &b| (own(b) * sizes[b].y).total_cmp(&(own(a) * sizes[a].y)));
        let mut horizon = vec![0_i64; side];
        let mut places = vec![None; charts.len()];
        for i in order {
            let columns = Columns::new(&charts[i], own(i), sizes[i], side)?;
            let [x, y] = self.drop(&columns, &mut horizon)?;
            let half = 0.5 * self.margin as f64;
            let cells = self.cells as f64;
            places[i] = Some(Place {
                scale: own(i) / cells,
                offset: (DVec2::new(x as f64, y as f64) + half) / cells,
            });
        }
        places.into_iter().collect()
    }

    /// The cell at which a chart's lower left corner comes to lie; none if there is none.
    fn drop(&self, chart: &Columns, horizon: &mut [i64]) -> Option<[usize; 2]> {
        let (side, margin) = (horizon.len(), self.margin);
        let width = chart.bottom.len();
        let below = chart.widened(margin);
        let mut best: Option<(i64, i64, usize)> = None;
        for x in 0..(side + 1).checked_sub(width)? {
            // Column 0 of what is widened lies `margin` to the left of the chart.
            let mut y = 0;
            let mut sum = 0;
            let last = best.map_or(i64::MAX, |best| best.0);
            for (k, &bottom) in below.iter().enumerate() {
                let Some(&top) = (x + k).checked_sub(margin).and_then(|c| horizon.get(c)) else {
                    continue;
                };
                sum += top;
                if top > 0 {
                    y = y.max(top + margin as i64 - bottom);
                }
                if y > last {
                    break;
                }
            }
            // Lowest first, then where least is lost below.
            let lost = -sum;
            if y <= last && best.is_none_or(|best| (y, lost) < (best.0, best.1)) {
                best = Some((y, lost, x));
            }
        }
        let (y, _, x) = best?;
        for (k, &top) in chart.top.iter().enumerate() {
            horizon[x + k] = horizon[x + k].max(y + top);
        }
        let high = y + chart.top.iter().max()?;
        (high <= side as i64).then_some([x, y as usize])
    }
}

/// The cells that a chart touches, column by column.
struct Columns {
    /// The lowest.
    bottom: Vec<i64>,
    /// Above the highest.
    top: Vec<i64>,
}

impl Columns {
    /// None if it is more than `most` cells wide or high.
    fn new(chart: &Flat, scale: f64, size: DVec2, most: usize) -> Option<Self> {
        let [width, height] = (scale * size).to_array();
        if !(width <= most as f64 && height <= most as f64) {
            return None;
        }
        let width = (width.floor() as usize + 1).min(most);
        let mut bottom = vec![i64::MAX; width];
        let mut top = vec![0; width];
        let border = &chart.disk.border;
        let place = |i: usize| scale * chart.places[border[i % border.len()] as usize];
        for i in 0..border.len() {
            let (a, b) = (place(i), place(i + 1));
            let (a, b) = if a.x <= b.x { (a, b) } else { (b, a) };
            let last = (b.x.max(0.0) as usize).min(width - 1);
            let first = (a.x.max(0.0) as usize).min(last);
            for column in first..=last {
                let at = |x: f64| match b.x - a.x {
                    0.0 => a.y,
                    run => a.y + (b.y - a.y) * ((x - a.x) / run).clamp(0.0, 1.0),
                };
                let ends = match a.x < b.x {
                    true => [at(column as f64), at(column as f64 + 1.0)],
                    false => [a.y, b.y],
                };
                let (low, high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
                // A little more than what rounding takes.
                bottom[column] = bottom[column].min((low - 1e-6).max(0.0).floor() as i64);
                top[column] = top[column].max((high + 1e-6).floor() as i64 + 1);
            }
        }
        let most = most as i64;
        top.iter_mut().for_each(|top| *top = (*top).min(most));
        Some(Self { bottom, top })
    }

    /// The lowest within `margin` columns, from `margin` columns before the first on.
    fn widened(&self, margin: usize) -> Vec<i64> {
        let n = self.bottom.len();
        (0..n + 2 * margin)
            .map(|k| {
                let from = k.saturating_sub(2 * margin).min(n - 1);
                let to = k.min(n - 1);
                let near = self.bottom[from..=to].iter();
                near.min().copied().unwrap_or(0)
            })
            .collect()
    }
}

/// Turns places so that the smallest rectangle around them is upright, its lower left corner at the origin. Gives its
/// size.
fn stand_upright(places: &mut [DVec2]) -> DVec2 {
    let hull = hull(places);
    let mut best = (f64::INFINITY, DVec2::X);
    for i in 0..hull.len() {
        let Some(x) = (hull[(i + 1) % hull.len()] - hull[i]).try_normalize() else {
            continue;
        };
        let (least, most) = extent(&hull, x);
        let size = most - least;
        let area = size.x * size.y;
        if area < best.0 * (1.0 - 1e-9) {
            let x = if size.x > size.y { -x.perp() } else { x };
            best = (area, x);
        }
    }
    let x = best.1;
    let (least, most) = extent(places, x);
    for p in places.iter_mut() {
        *p = DVec2::new(p.dot(x), p.dot(x.perp())) - least;
    }
    most - least
}

/// The box of points in axes of which the first is `x`.
fn extent(points: &[DVec2], x: DVec2) -> (DVec2, DVec2) {
    let start = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    points.iter().fold(start, |(least, most), p| {
        let p = DVec2::new(p.dot(x), p.dot(x.perp()));
        (least.min(p), most.max(p))
    })
}

/// The convex hull, counterclockwise (Andrew 1979).
fn hull(points: &[DVec2]) -> Vec<DVec2> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    sorted.dedup();
    let mut hull: Vec<DVec2> = Vec::new();
    let mut chain = |points: &mut dyn Iterator<Item = DVec2>| {
        let start = hull.len();
        for p in points {
            while let [.., a, b] = hull[start..] {
                if (b - a).perp_dot(p - a) > 0.0 {
                    break;
                }
                hull.pop();
            }
            hull.push(p);
        }
        hull.pop();
    };
    chain(&mut sorted.iter().copied());
    chain(&mut sorted.iter().rev().copied());
    hull
}
