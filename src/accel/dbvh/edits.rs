//! Other heights on the same quads: the image, its scale or its bias change, and only what follows from them is made anew.
//!
//! Scale and bias: points that edges keep, and boxes. Another image: the ranges of all blocks besides. As Thonat et al.
//! (2021) and Thonat, Georgiev, Beaune, Boubekeur ("RMIP: Displacement ray-tracing via inversion and oblong bounding",
//! SIGGRAPH Asia 2023) update theirs.

use super::Dbvh;
use super::heights::Source;
use super::source::{displaced, range, source};
use crate::error::{Error, Result};
use crate::surface::{Displacement, Surface};

impl Dbvh {
    /// Displaces by other heights: boxes are made anew, and the quads stay. `surface` is what it was built of, but for the
    /// scale, the bias and the image of its displacement. Rays then meet what they would had it been built so, with the
    /// same [`heights`](super::DbvhOptions::heights).
    ///
    /// # Errors
    /// [`Error::Usage`] if heights are beyond those that the quads were made for, or come from elsewhere than before:
    /// from an image that is looked up at other places, say, or from primvars or Ptex, which are looked up while building.
    pub fn displace(&mut self, surface: &Surface) -> Result<()> {
        let refused = |what: String| Err(Error::usage(what, "build it anew"));
        let amount = match surface.displacement() {
            Displacement::Scalar(amount) => Some(amount),
            Displacement::None => None,
            Displacement::Vector(..) => return refused("it is displaced by vectors".to_owned()),
        };
        let source = source(surface, amount);
        let is_new = match (&source, &self.heights.source) {
            (Source::Flat(_), Source::Flat(_)) => true,
            (Source::Image(new), Source::Image(old)) if new.is_placed_like(old) => {
                !new.is_same(old)
            }
            _ => return refused("its heights come from elsewhere than before".to_owned()),
        };
        let range = range(&source);
        let [low, high] = displaced(amount, range);
        let [least, most] = self.built_for;
        if low < least || high > most {
            return refused(format!(
                "heights from {low} to {high} are beyond those that it was built for, {least} to {most}"
            ));
        }
        self.heights.source = source;
        self.set(amount, range);
        if is_new {
            self.look_at(&|_| true)?;
        }
        let extents = self.extents();
        self.top.refit(&extents);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::*;
    use crate::accel::Intersector;
    use crate::accel::dbvh::DbvhOptions;
    use crate::accel::tests::random_ray;
    use crate::image::Wrap;
    use crate::surface::tests::shapes::{Patches, Random, noise};
    use crate::surface::tests::{amount, closed, mixed, surface};
    use crate::surface::{Amount, Channels, Function, ImageMap, Rates};

    const HEIGHTS: Option<[f32; 2]> = Some([-0.4, 0.4]);

    fn built(surface: &Surface, rates: &Rates) -> Dbvh {
        let options = DbvhOptions {
            heights: HEIGHTS,
            ..DbvhOptions::default()
        };
        Dbvh::build(surface, rates, &options, &|_| true).expect("it is built")
    }

    fn image(seed: u64, size: [u32; 2]) -> ImageMap {
        ImageMap::new(noise(size, "Y", Wrap::Repeat, seed), Channels::Scalar)
    }

    fn displaced_by(map: &ImageMap, scale: f32, bias: f32) -> Displacement {
        Displacement::Scalar(Amount {
            bias,
            ..amount(map.clone(), scale)
        })
    }

    /// The same bits as if it were built so.
    #[test]
    fn edits_trace_what_a_new_build_does() {
        let (first, second) = (image(5, [64, 48]), image(6, [80, 50]));
        let edits = [
            (&first, 0.25, 0.0),
            (&first, 0.1, -0.15),
            (&second, 0.1, -0.15),
            (&first, -0.2, 0.1),
            (&second, 0.0, 0.0),
        ];
        for (shape, base) in closed() {
            for base in [base.clone(), base.clone().moving(|p| 1.2 * p)] {
                let of = |displacement| surface(base.clone(), displacement);
                let start = of(displaced_by(&first, 0.1, 0.0));
                let rates = mixed(&start);
                let mut tree = built(&start, &rates);
                for (map, scale, bias) in edits {
                    let edited = of(displaced_by(map, scale, bias));
                    tree.displace(&edited)
                        .expect("it is within what it was built for");
                    let fresh = built(&edited, &rates);
                    assert_eq!(tree.kept, fresh.kept, "{shape}");
                    let mut random = Random(3);
                    let mut hits = 0;
                    for _ in 0..100 {
                        let ray = random_ray(&mut random);
                        let hit = tree.intersect(0, &ray);
                        assert_eq!(hit, fresh.intersect(0, &ray), "{shape}: {scale} {bias}");
                        hits += usize::from(hit.is_some());
                    }
                    assert!(hits > 10, "{shape}: {hits}");
                }
            }
        }
    }

    #[test]
    fn what_needs_a_new_build_is_refused() {
        let base = Patches::torus(5, 3);
        let map = image(5, [64, 48]);
        let start = surface(base.clone(), displaced_by(&map, 0.1, 0.0));
        let rates = mixed(&start);
        let mut tree = built(&start, &rates);
        let function = Function::scalar(|at| at.uv.x);
        let turned = map.moved(crate::math::Affine2::from_angle(0.5));
        for displacement in [
            displaced_by(&map, 10.0, 0.0),
            displaced_by(&turned, 0.1, 0.0),
            Displacement::Scalar(amount(function, 0.1)),
            Displacement::None,
        ] {
            let refused = tree.displace(&surface(base.clone(), displacement));
            assert_eq!(refused.expect_err("it is refused").exit_code(), 2);
        }
        // Nothing has changed.
        let (fresh, mut random) = (built(&start, &rates), Random(3));
        for _ in 0..100 {
            let ray = random_ray(&mut random);
            assert_eq!(tree.intersect(0, &ray), fresh.intersect(0, &ray));
        }
    }

    /// Tells how long edits take on eight million micro-triangles with images of 4096 x 4096.
    #[test]
    fn edits_of_a_large_surface_are_told() {
        let maps = [5, 6].map(|seed| image(seed, [4096, 4096]));
        let base = Patches::cube();
        let of = |map: &ImageMap, scale: f32| surface(base.clone(), displaced_by(map, scale, 0.0));
        let start = of(&maps[0], 0.1);
        let rates = Rates::uniform(&start, 816);
        let mut tree = built(&start, &rates);
        for (what, edited) in [
            ("scale", of(&maps[0], 0.2)),
            ("scale", of(&maps[0], 0.3)),
            ("image", of(&maps[1], 0.3)),
            ("image", of(&maps[0], 0.3)),
        ] {
            let begin = Instant::now();
            tree.displace(&edited)
                .expect("it is within what it was built for");
            let seconds = begin.elapsed().as_secs_f64();
            println!(
                "{what}: {:.2} ms for {} micro-triangles",
                1e3 * seconds,
                tree.micro_triangles()
            );
        }
        let fresh = built(&of(&maps[0], 0.3), &rates);
        let mut random = Random(3);
        for _ in 0..100 {
            let ray = random_ray(&mut random);
            assert_eq!(tree.intersect(0, &ray), fresh.intersect(0, &ray));
        }
    }
}
