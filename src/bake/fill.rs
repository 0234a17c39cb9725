//! Filling texels that nothing is known of from those around, by diffusion.
//!
//! What is open first grows inward from the known texels, ring by ring, each texel the mean of its neighbours that have
//! a value by then. Then each is set to the mean of all its neighbours again and again (Gauss-Seidel on the Laplace
//! equation), which takes the seams out; known texels stay.

/// How often the open texels are gone over at most.
const SWEEPS: usize = 200;
/// Changes that are small enough to end, as a part of the range of what is known.
const SETTLED: f32 = 1e-4;

/// Sets the texels that are not `known`, of `channels` numbers each. `neighbours` adds those around a texel. Texels that
/// no known one is connected to stay as they are; how many these are is returned.
pub(super) fn fill(
    values: &mut [f32],
    channels: usize,
    known: &[bool],
    mut neighbours: impl FnMut(usize, &mut Vec<usize>),
) -> usize {
    let open: Vec<usize> = (0..known.len()).filter(|&t| !known[t]).collect();
    if open.is_empty() {
        return 0;
    }
    // By open texel, in order: who is around it.
    let (mut starts, mut around) = (vec![0], Vec::new());
    for &texel in &open {
        neighbours(texel, &mut around);
        starts.push(around.len());
    }
    let around = |i: usize| &around[starts[i]..starts[i + 1]];

    let order = grow(values, channels, known, &open, &around);
    let range = (values.chunks_exact(channels).zip(known))
        .filter(|(_, known)| **known)
        .flat_map(|(value, _)| value)
        .fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], &x| {
            [low.min(x), high.max(x)]
        });
    let mut mean = vec![0.0; channels];
    for _ in 0..SWEEPS {
        let mut change = 0.0_f32;
        for &i in &order {
            mean_of(values, around(i), &mut mean);
            let value = &mut values[channels * open[i]..][..channels];
            for (value, mean) in value.iter_mut().zip(&mean) {
                change = change.max((*value - mean).abs());
                *value = *mean;
            }
        }
        if change <= SETTLED * (range[1] - range[0]) {
            break;
        }
    }
    open.len() - order.len()
}

/// Gives open texels a first value, nearest to the known ones first, and returns them (by their numbers in `open`) in
/// that order.
fn grow<'a>(
    values: &mut [f32],
    channels: usize,
    known: &[bool],
    open: &[usize],
    around: &impl Fn(usize) -> &'a [usize],
) -> Vec<usize> {
    let place = |texel: usize| open.binary_search(&texel).ok();
    // Which open texels have an open one around them.
    let mut beside: Vec<Vec<u32>> = vec![Vec::new(); open.len()];
    for i in 0..open.len() {
        for other in around(i).iter().filter_map(|&t| place(t)) {
            beside[other].push(i as u32);
        }
    }
    let is_first = |&i: &usize| around(i).iter().any(|&t| known[t]);
    let mut ring: Vec<usize> = (0..open.len()).filter(is_first).collect();
    let mut met = vec![false; open.len()];
    ring.iter().for_each(|&i| met[i] = true);
    let mut has_value = known.to_vec();
    let (mut order, mut with_value, mut mean) = (Vec::new(), Vec::new(), vec![0.0; channels]);
    while !ring.is_empty() {
        for &i in &ring {
            with_value.clear();
            with_value.extend(around(i).iter().copied().filter(|&t| has_value[t]));
            mean_of(values, &with_value, &mut mean);
            values[channels * open[i]..][..channels].copy_from_slice(&mean);
        }
        let mut next = Vec::new();
        for &i in &ring {
            has_value[open[i]] = true;
            for &other in &beside[i] {
                let other = other as usize;
                if !std::mem::replace(&mut met[other], true) {
                    next.push(other);
                }
            }
        }
        order.append(&mut ring);
        ring = next;
    }
    order
}

fn mean_of(values: &[f32], texels: &[usize], mean: &mut [f32]) {
    let channels = mean.len();
    mean.fill(0.0);
    for &texel in texels {
        let value = &values[channels * texel..][..channels];
        mean.iter_mut().zip(value).for_each(|(sum, x)| *sum += x);
    }
    mean.iter_mut().for_each(|sum| *sum /= texels.len() as f32);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Texels of a line, each beside the one before and the one after.
    fn line(values: &mut [f32], known: &[bool]) -> usize {
        let last = known.len() - 1;
        fill(values, 1, known, |t, out| {
            out.extend(t.checked_sub(1));
            out.extend((t < last).then_some(t + 1));
        })
    }

    #[test]
    fn a_gap_becomes_a_ramp_and_an_end_goes_on() {
        let mut values = [1.0, 9.0, 9.0, 9.0, 5.0, 9.0];
        let known = [true, false, false, false, true, false];
        assert_eq!(line(&mut values, &known), 0);
        for (value, wanted) in values.iter().zip([1.0, 2.0, 3.0, 4.0, 5.0, 5.0]) {
            assert!((value - wanted).abs() < 1e-2, "{values:?}");
        }
    }

    #[test]
    fn what_nothing_is_known_of_stays() {
        let mut values = [0.0, 0.0];
        assert_eq!(line(&mut values, &[false, false]), 2);
        assert_eq!(values, [0.0, 0.0]);
    }
}
