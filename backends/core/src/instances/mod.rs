//! What a camera sees of many placed objects: a hierarchy over them, through which each ray goes once.
//!
//! A view has a transform of its own, so that one object can be placed many times: its octree is loaded once. All rays of a
//! picture start at the eye. Therefore the hierarchy is not over boxes in space but over their pictures, rectangles of pixels
//! with a least depth. There the rays are parallel: a node is tested by comparing a pixel's column and row, and one order of
//! the nodes is front to back for all rays.

mod footprint;
mod hierarchy;

use std::ops::Range;

use self::footprint::ray_margin;
pub use self::hierarchy::{NO_INSTANCE, Node};
use crate::{CastError, Hit, Nearest, Ray, View};

/// The views of one camera, one for each placed object, and a hierarchy over what they show.
///
/// Moving the objects or the camera makes new ones. It takes about a microsecond for each view; nothing of an octree is read.
#[derive(Clone, Debug)]
pub struct Instances {
    views: Vec<View>,
    nodes: Vec<Node>,
    rules: Rules,
}

/// What a broken caster of the conformance suite does differently.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rules {
    /// Where a ray ends that found a hit at the first number, with the margin that rounding needs.
    pub(crate) end: fn(f32, f32) -> f32,
    /// Whether a hit replaces another one; both with the number of their view.
    pub(crate) replaces: fn((f32, u32), (f32, u32)) -> bool,
}

impl Rules {
    const RIGHT: Self = Self {
        end: |t, margin| (t + margin).min(1.0),
        replaces: |(t, view), (other_t, other_view)| t < other_t || (t == other_t && view < other_view),
    };
}

/// Room for the rays of one instance, to be used again.
#[derive(Debug, Default)]
pub struct Batch {
    rays: Vec<Ray>,
    /// For each ray, the number of its pixel in the band.
    pixels: Vec<usize>,
    hits: Vec<Hit>,
}

/// Pixels next to each other are cast next to each other, in blocks of this edge.
const BLOCK: usize = 4;

impl Instances {
    /// Views as [`View::new`] makes them, of one camera: of the same size and with the same options. Beams are not used: they
    /// change no hit.
    ///
    /// # Errors
    /// [`CastError::View`]: there is no view, [`View::check`] refuses one, they do not go together, or they are more than
    /// 2^30.
    pub fn new(views: Vec<View>) -> Result<Self, CastError> {
        let bad = |what: &str| Err(CastError::View(what.into()));
        let Some(first) = views.first() else { return bad("there is none; give one for each object") };
        if views.len() > 1 << 30 {
            return bad("there are more than 2^30");
        }
        for view in &views {
            view.check()?;
            if (view.width, view.height) != (first.width, first.height) {
                return bad("views of one picture must have the same size");
            }
            if (view.contours(), view.max_voxel_pixels) != (first.contours(), first.max_voxel_pixels) {
                return bad("views of one picture must have the same contours flag and max_voxel_pixels");
            }
        }
        let nodes = hierarchy::build(&views);
        Ok(Self { views, nodes, rules: Rules::RIGHT })
    }

    /// The views, by their numbers. There is one at least.
    pub fn views(&self) -> &[View] {
        &self.views
    }

    /// The hierarchy. Empty if nothing can be seen.
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// Casts the pixels of some columns in a band of whole rows: for engines. `cast` casts rays against the object of a view.
    ///
    /// `hits` and `views` are those of the rows from `first_row` on, as of [`Nearest`], and come out filled in those columns.
    /// Each instance is cast once, if its rectangle meets this one: its rays are those of the pixels in both that have no
    /// nearer hit yet, and end a little behind the nearest hit so far.
    ///
    /// # Errors
    /// Those of `cast`.
    pub fn cast_band<E>(
        &self,
        columns: Range<u32>,
        first_row: u32,
        (hits, views): (&mut [Hit], &mut [u32]),
        batch: &mut Batch,
        mut cast: impl FnMut(&View, &[Ray], &mut Vec<Hit>) -> Result<(), E>,
    ) -> Result<(), E> {
        let width = self.views[0].width as usize;
        let end_row = first_row + (hits.len() / width) as u32;
        for row in 0..hits.len() / width {
            let row = row * width;
            hits[row + columns.start as usize..row + columns.end as usize].fill(Hit::miss(0));
            views[row + columns.start as usize..row + columns.end as usize].fill(0);
        }
        let mut at = 0;
        while let Some(node) = self.nodes.get(at) {
            let left = node.low[0].max(columns.start);
            let right = (node.high[0] + 1).min(columns.end);
            let top = node.low[1].max(first_row);
            let bottom = (node.high[1] + 1).min(end_row);
            if left >= right || top >= bottom {
                at = node.skip as usize;
                continue;
            }
            at += 1;
            if node.number == NO_INSTANCE {
                continue;
            }
            batch.rays.clear();
            batch.pixels.clear();
            for (y, x) in blocks(top..bottom).flat_map(|rows| {
                blocks(left..right).flat_map(move |columns| {
                    let columns = columns.clone();
                    rows.clone().flat_map(move |y| columns.clone().map(move |x| (y, x)))
                })
            }) {
                let pixel = (y - first_row) as usize * width + x as usize;
                // That of a miss is greater than that of any hit of a picture.
                let nearest = hits[pixel].raw_t;
                if node.t > nearest {
                    continue;
                }
                let mut ray = node.view.ray(x, y);
                ray.t_max = (self.rules.end)(nearest, ray_margin(&node.view, ray.direction));
                batch.rays.push(ray);
                batch.pixels.push(pixel);
            }
            if batch.rays.is_empty() {
                continue;
            }
            cast(&node.view, &batch.rays, &mut batch.hits)?;
            for (&pixel, hit) in batch.pixels.iter().zip(&batch.hits) {
                let (to, whose) = (&mut hits[pixel], &mut views[pixel]);
                let iterations = to.iterations.saturating_add(hit.iterations);
                if !hit.is_miss() && (self.rules.replaces)((hit.raw_t, node.number), (to.raw_t, *whose)) {
                    (*to, *whose) = (*hit, node.number);
                }
                to.iterations = iterations;
            }
        }
        Ok(())
    }

    /// Casts the whole picture by `cast`, which casts rays against the object of a view.
    ///
    /// # Errors
    /// Those of `cast`.
    pub(crate) fn cast_all<E>(
        &self,
        nearest: &mut Nearest,
        cast: impl FnMut(&View, &[Ray], &mut Vec<Hit>) -> Result<(), E>,
    ) -> Result<(), E> {
        let view = &self.views[0];
        nearest.resize(view);
        let Nearest { hits, views } = nearest;
        self.cast_band(0..view.width, 0, (hits, views), &mut Batch::default(), cast)
    }

    /// The same with a mistake.
    pub(crate) fn broken(mut self, rules: impl FnOnce(&mut Rules), nodes: impl FnMut(&mut Node)) -> Self {
        rules(&mut self.rules);
        self.nodes.iter_mut().for_each(nodes);
        self
    }
}

/// A range, cut where multiples of [`BLOCK`] lie.
fn blocks(range: Range<u32>) -> impl Iterator<Item = Range<u32>> + Clone {
    let first = range.start / BLOCK as u32 * BLOCK as u32;
    (first..range.end).step_by(BLOCK).map(move |at| at.max(range.start)..(at + BLOCK as u32).min(range.end))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::instances::{camera, moving, views};
    use crate::testing::sample::two_objects;
    use crate::{CastOptions, FLAG_CONTOURS};

    #[test]
    fn views_that_do_not_go_together_are_refused() {
        let octree = two_objects().unwrap();
        let good = views(&octree, &moving(2, 0), &camera(false), (8, 8), &CastOptions::default()).unwrap();
        Instances::new(good.clone()).unwrap();
        for (what, bad) in [
            ("there is none", vec![]),
            ("same size", vec![good[0], View { width: 9, ..good[1] }]),
            ("same contours", vec![good[0], View { flags: good[1].flags ^ FLAG_CONTOURS, ..good[1] }]),
            ("same contours", vec![good[0], View { max_voxel_pixels: 2.0, ..good[1] }]),
            ("origin", vec![good[0], View { origin: [f32::NAN; 3], ..good[1] }]),
        ] {
            let error = Instances::new(bad).unwrap_err().to_string();
            assert!(error.contains(what), "{what}: {error}");
        }
    }

    #[test]
    fn rays_end_a_little_behind_the_nearest_hit() {
        let octree = two_objects().unwrap();
        let views = views(&octree, &moving(60, 0), &camera(false), (64, 48), &CastOptions::default()).unwrap();
        let instances = Instances::new(views).unwrap();
        let mut nearest = Nearest::default();
        let (mut all, mut cut) = (0, 0);
        instances
            .cast_all(&mut nearest, |view, rays, hits| {
                hits.clear();
                for ray in rays {
                    all += 1;
                    cut += u32::from(ray.t_max < 1.0);
                    assert!(ray.t_max <= 1.0 && ray.t_max > 0.1);
                    hits.push(crate::reference::cast_ray(&octree, view.root, ray, true));
                }
                Ok::<_, CastError>(())
            })
            .unwrap();
        assert!(cut > 100 && cut < all / 2, "{cut} of {all}");
    }
}
