//! By which method each object is traced, and whether all of them fit.

use super::build::BuildOptions;
use super::estimate::{Counts, Need};
use super::method::{Choice, Method};
use super::prepare::{Form, Prepared};
use crate::accel::CacheSize;
use crate::error::{Error, Result};
use crate::memory::{Budget, amount, of_machine};
use crate::surface::Dicing;

/// What the program takes before a scene is there: code, libraries, threads. Measured, and rounded up.
const PROGRAM: u64 = 160 << 20;

/// What is kept free of a budget when methods are chosen: that estimates are no better than this.
const SPARE: f64 = 0.06;

/// Of so many micro-triangles of a scene, an object with less than one is small.
const SMALL: u64 = 256;

/// The cache at least, where it may be chosen.
const LEAST_CACHE: u64 = 8 << 20;

/// Dicing rates that are tried for advice. Each takes as long as the scene's surfaces took to prepare.
const TRIES: usize = 6;

/// An object, as far as it decides about memory.
#[derive(Debug, Clone, Copy)]
pub(super) struct Item {
    pub(super) counts: Counts,
    /// As it is diced for paths that have bounced, if that is done otherwise.
    pub(super) bounced: Option<Counts>,
    /// Whether Embree builds it together with all others.
    pub(super) together: bool,
}

impl Item {
    /// What a method takes of it.
    pub(super) fn need(&self, method: Method) -> Need {
        let need = method.need(&self.counts);
        match &self.bounced {
            Some(bounced) if method.is_diced() => need.and(method.need(bounced)),
            _ => need,
        }
    }
}

/// What was decided.
#[derive(Debug, Clone)]
pub(super) struct Plan {
    /// By shape; the first choice's method where nothing is to be decided.
    pub(super) methods: Vec<Method>,
    /// Of the cache, if there is to be one.
    pub(super) cache: Option<CacheSize>,
    /// What decided of each shape.
    pub(super) items: Vec<Item>,
}

/// The most that all objects take at once.
pub(super) fn peak(items: &[Item], methods: &[Method]) -> u64 {
    let (mut held, mut together, mut alone) = (0, 0, 0);
    for (item, method) in items.iter().zip(methods) {
        let need = item.need(*method);
        held += need.held;
        alone = alone.max(need.dicing);
        if item.together {
            together += need.commit;
        } else {
            alone = alone.max(need.commit);
        }
    }
    held + alone.max(together)
}

/// The same, and a fifth more of what Embree builds: it asks its memory monitor for more than it comes to write to, and what
/// was freed before is not given back to the system at once.
fn cautious(items: &[Item], methods: &[Method]) -> u64 {
    let of_embree = |(item, method): (&Item, &Method)| match method {
        Method::EmbreeSubdivision
        | Method::EmbreeTriangles
        | Method::EmbreeGrid
        | Method::EmbreeGridCompact => item.need(*method).peak(),
        Method::Tessellated
        | Method::Compact
        | Method::Compressed
        | Method::Cache
        | Method::Dbvh
        | Method::Nonlinear => 0,
    };
    let of_embree: u64 = items.iter().zip(methods).map(of_embree).sum();
    peak(items, methods) + of_embree / 5
}

/// Chooses for each object, within so many bytes for all of them: Embree's triangles, else `compact`, else `cache`, the
/// small ones first; and of small ones Embree's grids before `compact`, since there its trees are no smaller. Also the
/// size of the cache, if any object is in it.
pub(super) fn choose(items: &[Item], bytes: u64) -> (Vec<Method>, u64) {
    // Tiles are never copied.
    let diced = |item: &&Item| !item.counts.is_tiled();
    let all: u64 = (items.iter().filter(diced))
        .map(|item| item.counts.micro_triangles)
        .sum();
    let mut methods = vec![Method::Compact; items.len()];
    let fallback = if peak(items, &methods) <= bytes {
        Method::Compact
    } else {
        Method::Cache
    };
    let cache = |methods: &[Method]| {
        if methods.contains(&Method::Cache) {
            LEAST_CACHE.max(bytes / 8)
        } else {
            0
        }
    };
    methods.fill(fallback);
    let mut order: Vec<usize> = (0..items.len())
        .filter(|&i| !items[i].counts.is_tiled())
        .collect();
    order.sort_by_key(|&i| (items[i].counts.micro_triangles, i));
    for i in order {
        let is_small = items[i].counts.micro_triangles < all.div_ceil(SMALL);
        let wanted: &[Method] = if is_small {
            &[Method::EmbreeTriangles, Method::EmbreeGrid, Method::Compact]
        } else {
            &[Method::EmbreeTriangles, Method::Compact]
        };
        for &method in wanted {
            methods[i] = method;
            if cautious(items, &methods) + cache(&methods) <= bytes {
                break;
            }
            methods[i] = fallback;
        }
    }
    // What is left is the cache's, as far as it could be filled.
    let of_cache = |method: &Method| *method == Method::Cache;
    let filled: u64 = (items.iter().zip(&methods))
        .filter(|(_, method)| of_cache(method))
        .map(|(item, _)| item.need(Method::Compact).held)
        .sum();
    let left = bytes.saturating_sub(cautious(items, &methods));
    let size = left.clamp(LEAST_CACHE, filled.max(LEAST_CACHE));
    (methods, size)
}

/// What [`choose`] may spend: of a budget, or half of the machine's memory, what is left by all that is there without
/// objects. It is the same however many threads there are, and so is what is chosen.
pub(super) fn to_spend(budget: &Budget, known: u64) -> u64 {
    let limit = match budget.limit() {
        Some(limit) => limit as u64,
        None => of_machine().map_or(8 << 30, |all| all as u64 / 2),
    };
    ((limit as f64 * (1.0 - SPARE)) as u64).saturating_sub(known + PROGRAM)
}

/// The methods of all shapes. `known` are the bytes of all that is held beside objects.
///
/// # Errors
/// [`Error::Memory`] if they will not fit: says what is largest, and what would fit.
pub(super) fn plan(
    prepared: &[Prepared<'_>],
    options: &BuildOptions,
    budget: &Budget,
    known: u64,
) -> Result<Plan> {
    let items = items(prepared, None, options.bounce_dicing);
    let (methods, automatic) = match options.method {
        Choice::Auto => choose(&items, to_spend(budget, known + polygons(prepared))),
        Choice::One(method) => {
            let of = |form: &Form<'_>| match form {
                Form::Smooth(smooth)
                    if method == Method::EmbreeSubdivision && smooth.embree.is_none() =>
                {
                    Method::EmbreeTriangles
                }
                Form::Smooth(smooth) => method.on(&smooth.surface),
                Form::Polygons(_) => method,
            };
            (prepared.iter().map(|p| of(&p.form)).collect(), u64::MAX)
        }
    };
    let cache = methods.contains(&Method::Cache).then(|| {
        let usual = CacheSize::default().0 as u64;
        let eighth = budget.limit().map_or(u64::MAX, |limit| limit as u64 / 8);
        let half = budget.left().map_or(u64::MAX, |left| left as u64 / 2);
        let size = match options.method {
            Choice::Auto => automatic,
            Choice::One(_) => usual.min(eighth).min(half),
        };
        options.cache_size.unwrap_or(CacheSize(size as usize))
    });
    let plan = Plan {
        methods,
        cache,
        items,
    };
    check(prepared, &plan, options, budget)?;
    Ok(plan)
}

/// What decides of all shapes, diced as they are or otherwise.
pub(super) fn items(
    prepared: &[Prepared<'_>],
    dicing: Option<&Dicing>,
    bounce_dicing: Option<f32>,
) -> Vec<Item> {
    let item = |p: &Prepared<'_>| {
        let (counts, bounced) = match &p.form {
            Form::Polygons(_) => (Counts::default(), None),
            Form::Smooth(smooth) => smooth.counts_by(dicing, bounce_dicing),
        };
        Item {
            counts,
            bounced,
            together: p.in_world.is_some(),
        }
    };
    prepared.iter().map(item).collect()
}

/// What will not fit is not begun.
fn check(
    prepared: &[Prepared<'_>],
    plan: &Plan,
    options: &BuildOptions,
    budget: &Budget,
) -> Result<()> {
    let items = &plan.items;
    let Some(left) = budget.left() else {
        return Ok(());
    };
    let cache = plan.cache.map_or(0, |size| size.0 as u64);
    let needed = peak(items, &plan.methods) + cache + polygons(prepared);
    if budget.grants() && needed <= left as u64 {
        return Ok(());
    }
    let largest = (items.iter().zip(&plan.methods).zip(prepared))
        .map(|((item, method), p)| (item.need(*method), item, *method, p.wanted.path))
        .max_by_key(|(need, ..)| need.peak());
    let largest = largest.map_or_else(String::new, |(need, item, method, path)| {
        format!(
            "; the largest object is {path}: {} micro-triangles, about {} by {}",
            item.counts.micro_triangles,
            amount(need.peak() as f64),
            method.name()
        )
    });
    let Error::Memory { message, .. } = budget.exceeded(format!(
        "the scene's surfaces take about {}",
        amount(needed as f64)
    )) else {
        unreachable!("it is an error of memory");
    };
    Err(Error::Memory {
        message: message + &largest,
        help: Some(advice(prepared, plan, options, budget, needed)),
    })
}

/// Bytes of what is not diced.
pub(super) fn polygons(prepared: &[Prepared<'_>]) -> u64 {
    let of = |p: &Prepared<'_>| match &p.form {
        Form::Polygons(mesh) => {
            let corners = mesh.face_vertex_indices.len() as u64;
            let points: usize = mesh.points.iter().map(Vec::len).sum();
            130 * corners + 24 * points as u64
        }
        Form::Smooth(_) => 0,
    };
    prepared.iter().map(of).sum()
}

/// What would fit: another method, or coarser dicing by the same one.
fn advice(
    prepared: &[Prepared<'_>],
    plan: &Plan,
    options: &BuildOptions,
    budget: &Budget,
    needed: u64,
) -> String {
    let items = &plan.items;
    let left = budget.left().unwrap_or(usize::MAX) as f64 * (1.0 - SPARE);
    let cache = plan.cache.map_or(0, |size| size.0 as u64);
    let fixed = polygons(prepared);
    let mut advice = Vec::new();
    let smaller = [Method::EmbreeGrid, Method::Compact, Method::Cache];
    let fits = |method: &Method| {
        let own = if *method == Method::Cache {
            (budget.limit().unwrap_or(0) as u64 / 8).min(left as u64 / 2)
        } else {
            0
        };
        let methods = vec![*method; items.len()];
        Choice::One(*method) != options.method
            && (cautious(items, &methods) + own + fixed) as f64 <= left
    };
    if let Some(method) = smaller.iter().find(|method| fits(method)) {
        advice.push(format!("choose --method {}", method.name()));
    }
    // Micro-triangles go by the square of the rate, where edges are not held to the most segments, or the least.
    let mut dicing = options.dicing;
    let mut needed_now = (cautious(items, &plan.methods) + cache + fixed) as f64;
    for _ in 0..TRIES {
        let smaller = 1.05 * (needed_now / left.max(1.0)).sqrt();
        dicing.rate = rounded_up(dicing.rate * smaller.clamp(1.2, 16.0) as f32);
        let items = self::items(prepared, Some(&dicing), options.bounce_dicing);
        needed_now = (cautious(&items, &plan.methods) + cache + fixed) as f64;
        if needed_now <= left {
            let digits = usize::from(dicing.rate < 10.0) + usize::from(dicing.rate < 1.0);
            advice.push(format!("dice by --dicing-rate {:.digits$}", dicing.rate));
            break;
        }
    }
    let limit = budget.limit().unwrap_or(0) as f64;
    let needed = needed + cautious(items, &plan.methods) - peak(items, &plan.methods);
    let more = limit + (needed as f64 - left).max(0.0) * 1.05;
    advice.push(format!(
        "raise --memory-budget to {:.0}M",
        (more / f64::from(1 << 20)).ceil()
    ));
    advice.join(", or ")
}

/// To two digits.
fn rounded_up(rate: f32) -> f32 {
    let step = 10.0_f32.powi(rate.log10().floor() as i32 - 1);
    (rate / step).ceil() * step
}

/// What each shape is expected to take in the end, as it was planned.
pub(super) fn expected(p: &Prepared<'_>, item: &Item, method: Method) -> (Option<u64>, Need) {
    match &p.form {
        // Nothing is known of what was stored.
        Form::Smooth(smooth) if smooth.rates.is_none() => (None, Need::default()),
        Form::Smooth(_) => (Some(item.counts.micro_triangles), item.need(method)),
        Form::Polygons(_) => (
            None,
            Need {
                held: polygons(std::slice::from_ref(p)),
                ..Need::default()
            },
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn item(micro_triangles: u64) -> Item {
        Item {
            counts: Counts::of_quads(micro_triangles / 2),
            bounced: None,
            together: false,
        }
    }

    #[test]
    fn what_fits_is_in_triangles_and_what_does_not_is_smaller() {
        let items = [1_000, 20_000_000, 4_000_000, 300_000_000].map(item);
        let chosen = |bytes: u64| choose(&items, bytes).0;
        let [triangles, compact, cache] = [Method::EmbreeTriangles, Method::Compact, Method::Cache];
        assert_eq!(chosen(100 << 30), [triangles; 4]);
        assert_eq!(chosen(4 << 30), [triangles, triangles, triangles, compact]);
        assert_eq!(chosen(2 << 30), [triangles, compact, triangles, compact]);
        let (small, size) = choose(&items, 200 << 20);
        assert_eq!(small[3], cache);
        assert!((8 << 20..200 << 20).contains(&size), "{size}");
        for bytes in (2..60).map(|i| i * (100 << 20)) {
            let (methods, size) = choose(&items, bytes);
            let cache = if methods.contains(&cache) { size } else { 0 };
            assert!(
                peak(&items, &methods) + cache <= bytes,
                "{bytes}: {methods:?}"
            );
        }
    }

    #[test]
    fn what_is_small_is_not_in_trees_of_our_own() {
        let mut items = vec![item(2_000); 1000];
        items.push(item(800_000_000));
        let (methods, _) = choose(&items, 4 << 30);
        assert!(
            methods[..1000]
                .iter()
                .all(|m| *m == Method::EmbreeTriangles)
        );
        assert_eq!(methods[1000], Method::Compact);
    }
}
