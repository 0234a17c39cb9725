//! Where the names of marks go in a plot, so that none covers a mark or another name.
//!
//! Names are placed one after the other, as close to their mark as there is room; those that end up far from it get a
//! line to it. Few enough names that this greedy way always finds room.

/// In pixels, right and down.
pub(super) type Point = (i32, i32);

/// A box in pixels: left, top, right, bottom.
pub(super) type Area = [i32; 4];

/// The ends of a line.
type Leader = [Point; 2];

/// Height of a line of text, and the width of a letter at most, in pixels at the size of names.
pub(super) const LINE: i32 = 16;
pub(super) const LETTER: i32 = 8;

/// Half of a mark, with some air.
const MARK: i32 = 9;

/// A name's place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Place {
    /// The upper left corner of the text.
    pub(super) at: Point,
    /// A line to the mark, if there is to be one.
    pub(super) leader: Option<Leader>,
}

/// Places each name beside one of its marks, the first where there is room. `taken` are boxes to keep free beside the
/// marks.
pub(super) fn place(
    names: &[&str],
    marks: &[Vec<Point>],
    mut taken: Vec<Area>,
    within: Area,
) -> Vec<Place> {
    taken.extend(marks.iter().flatten().map(|&mark| around(mark, MARK)));
    let mut places = Vec::with_capacity(names.len());
    for (name, marks) in names.iter().zip(marks) {
        let size = (LETTER * name.chars().count() as i32, LINE);
        let candidates = candidates(marks, size);
        let has_room = |text: &Area| {
            is_inside(text, &within) && !taken.iter().any(|other| overlap(text, other))
        };
        let crosses = |leader: &Leader| {
            steps(*leader).any(|p| taken.iter().any(|other| overlap(&around(p, 1), other)))
        };
        let free = (candidates.iter())
            .find(|(text, leader)| has_room(text) && !leader.as_ref().is_some_and(crosses))
            // In a crowd of marks a line may have to run between them.
            .or_else(|| candidates.iter().find(|(text, _)| has_room(text)));
        // A plot too full for that has more methods than there are.
        let &(text, leader) = free.unwrap_or(&candidates[0]);
        taken.push(text);
        taken.extend(leader.into_iter().flat_map(steps).map(|p| around(p, 1)));
        places.push(Place {
            at: (text[0], text[1]),
            leader,
        });
    }
    places
}

/// Places for a text of this size around any of these marks, the best first.
fn candidates(marks: &[Point], size: Point) -> Vec<(Area, Option<Leader>)> {
    /// Right, left, above, below, then between.
    const DIRECTIONS: [(f32, f32); 12] = [
        (1.0, 0.0),
        (-1.0, 0.0),
        (0.0, -1.0),
        (0.0, 1.0),
        (0.7, -0.7),
        (0.7, 0.7),
        (-0.7, -0.7),
        (-0.7, 0.7),
        (0.9, -0.4),
        (0.9, 0.4),
        (-0.9, -0.4),
        (-0.9, 0.4),
    ];
    // Where a text begins that is before, around or behind a point, by the direction in which it lies.
    let start = |at: i32, size: i32, direction: f32| match direction {
        ..-0.1 => at - size,
        ..0.1 => at - size / 2,
        _ => at,
    };
    (0..24)
        .map(|ring| MARK + 1 + 14 * ring)
        .flat_map(|radius| marks.iter().map(move |mark| (radius, mark)))
        .flat_map(|(radius, mark)| DIRECTIONS.map(|direction| (radius, mark, direction)))
        .map(|(radius, mark, (x, y))| {
            let out = |distance: i32| {
                let along = |d: f32| (distance as f32 * d).round() as i32;
                (mark.0 + along(x), mark.1 + along(y))
            };
            let tip = out(radius);
            let (left, top) = (start(tip.0, size.0, x), start(tip.1, size.1, y));
            let leader = (radius > MARK + 1).then(|| [out(MARK + 2), out(radius - 2)]);
            ([left, top, left + size.0, top + size.1], leader)
        })
        .collect()
}

fn around(p: Point, half: i32) -> Area {
    [p.0 - half, p.1 - half, p.0 + half, p.1 + half]
}

/// Points of a line, close enough that no text slips between them.
fn steps([from, to]: Leader) -> impl Iterator<Item = Point> {
    let count = ((to.0 - from.0).abs().max((to.1 - from.1).abs()) / 4).max(1);
    (0..=count).map(move |i| {
        (
            from.0 + (to.0 - from.0) * i / count,
            from.1 + (to.1 - from.1) * i / count,
        )
    })
}

fn is_inside(a: &Area, b: &Area) -> bool {
    a[0] >= b[0] && a[1] >= b[1] && a[2] <= b[2] && a[3] <= b[3]
}

fn overlap(a: &Area, b: &Area) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::random::Random;

    #[test]
    fn names_cover_neither_marks_nor_each_other() {
        let names = ["embree-grid-compact"; 9];
        let within = [70, 40, 740, 380];
        for seed in 0..500 {
            let mut random = Random::new(seed);
            // All over the plot, or close together.
            let spread = if seed % 2 == 0 { 1.0 } else { 0.1 };
            let mut at = |low: i32, high: i32| {
                let middle = 0.5 * (low + high) as f32;
                (middle + spread * (random.next() - 0.5) * (high - low) as f32) as i32
            };
            let marks: Vec<Point> = names.map(|_| (at(80, 730), at(50, 370))).to_vec();
            let each: Vec<Vec<Point>> = marks.iter().map(|&mark| vec![mark]).collect();
            let places = place(&names, &each, Vec::new(), within);
            let texts: Vec<Area> = (places.iter().zip(names))
                .map(|(place, name)| {
                    let (left, top) = place.at;
                    let width = LETTER * name.len() as i32;
                    [left, top, left + width, top + LINE]
                })
                .collect();
            for (i, text) in texts.iter().enumerate() {
                assert!(is_inside(text, &within), "{seed}: {text:?}");
                assert!(
                    marks.iter().all(|&mark| !overlap(text, &around(mark, 6))),
                    "{seed}: {text:?} is on a mark of {marks:?}"
                );
                let others = texts[i + 1..].iter();
                assert_eq!(others.filter(|o| overlap(text, o)).count(), 0, "{seed}");
            }
        }
    }
}
