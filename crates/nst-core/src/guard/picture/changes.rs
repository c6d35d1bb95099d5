//! What experts change, and what of it is not believed.

use rayon::prelude::*;

use crate::Grid;

/// How many rows above and below are looked at.
pub(super) const REACH: u32 = 1;

/// How many times more light than samples have seen an expert may see in a lane.
const MOST_TIMES: f32 = 1000.0;

/// Turns estimates of the lanes of the inner rows of a strip into changes of `plain`, the plain
/// estimates of all its rows; 0 where they are not finite.
///
/// Next to what is very bright, an expert may take light from beyond an edge. In a few pixels that
/// may go unnoticed, as their sums say nothing of others. So nobody is believed who says a thousand
/// times what the samples say; where these are black, what those of the pixels around say. Where the
/// pixel is one that `sees_nothing`, by its number, light would be seen, and none is believed.
pub(super) fn believed_changes(
    grid: &Grid,
    sees_nothing: impl Fn(usize) -> bool + Sync,
    plain: &[f32],
    estimates: &mut [f32],
) {
    let (width, inner) = (grid.width(), grid.inner_rows());
    let planes = estimates.par_chunks_exact_mut(inner.len() * width);
    planes.zip(plain.par_chunks_exact(grid.pixels())).for_each(|(estimates, plain)| {
        let rows = estimates.par_chunks_exact_mut(width).zip(inner.clone());
        rows.for_each(|(estimates, row)| {
            for (x, estimate) in estimates.iter_mut().enumerate() {
                let pixel = row * width + x;
                let own = plain[pixel];
                let change = *estimate - own;
                let exceeds = |light: f32| *estimate > MOST_TIMES * light;
                // What is around counts where the lane is black, and nearly all are not.
                let too_bright = change > 0.0
                    && exceeds(own)
                    && (sees_nothing(pixel) || exceeds(light_near(plain, width, [x, row])));
                *estimate = if change.is_finite() && !too_bright { change } else { 0.0 };
            }
        });
    });
}

/// What samples say of a pixel, or, where they are black, the median of those around that are not.
/// Infinite, where all are.
fn light_near(plane: &[f32], width: usize, [x, row]: [usize; 2]) -> f32 {
    let own = plane[row * width + x];
    if own > 0.0 {
        return own;
    }
    let (mut lights, mut count) = ([f32::INFINITY; 9], 0);
    for row in plane.chunks_exact(width).take(row + 2).skip(row.saturating_sub(1)) {
        for &light in row.iter().take(x + 2).skip(x.saturating_sub(1)).filter(|it| **it > 0.0) {
            lights[count] = light;
            count += 1;
        }
    }
    lights.sort_unstable_by(f32::total_cmp);
    lights[count.saturating_sub(1) / 2]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_from_beyond_an_edge_is_not_believed() {
        // A bright row, then dark ones; one pixel is black, and one is alone in the black.
        let bright = [1e6, 2e6, 1e6, 3e6];
        let dark = [[1.0, 0.0, 2.0, 0.0], [0.5, 1.0, 0.0, 0.0], [0.0; 4], [0.0; 4]];
        let plain: Vec<f32> = bright.into_iter().chain(dark.into_iter().flatten()).collect();
        let grid = Grid::new(4, 5, 1, 0).expect("a grid");
        let changes_of = |sees_nothing: fn(usize) -> bool, value: f32| {
            let mut estimates = vec![value; plain.len()];
            believed_changes(&grid, sees_nothing, &plain, &mut estimates);
            estimates
        };
        let changes = |value: f32| changes_of(|_| false, value);
        // Ten times what is around is believed, and so is anything where nothing is known.
        assert_eq!(changes(20.0)[4..], plain[4..].iter().map(|s| 20.0 - s).collect::<Vec<_>>());
        let of_leak = changes(3000.0);
        assert_eq!(of_leak[0], 3000.0 - 1e6);
        // The last of the first dark row sees a bright pixel more often than a dark one.
        assert_eq!(of_leak[4..7], [0.0; 3]);
        assert_eq!(of_leak[8..10], [0.0; 2]);
        assert_eq!(of_leak[16..], [3000.0; 4]);
        assert_eq!(changes(f32::NAN), [0.0; 20]);
        assert_eq!(changes(-1.0)[5], -1.0);
        // In pixels that see nothing, what is there already is believed, and nothing else.
        let of_some = plain.iter().map(|s| if *s > 0.0 { 20.0 - s } else { 0.0 });
        assert_eq!(changes_of(|_| true, 20.0), of_some.collect::<Vec<_>>());
        assert_eq!(changes_of(|pixel| pixel > 15, 20.0)[14..], [20.0, 20.0, 0.0, 0.0, 0.0, 0.0]);
    }
}
