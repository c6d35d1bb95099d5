//! The last pass over a picture: finished rows go to a consumer while others are still traced.

use std::{
    collections::BTreeMap,
    mem,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
        mpsc::{Receiver, channel},
    },
    time::Instant,
};

use nst_core::{FurtherPowers, SequenceBatch, Side};
use rayon::{ThreadPoolBuilder, prelude::*};

use crate::{
    develop::{Buffers, Strip},
    film::TileFilm,
    tiles::{TILE, Tile},
};

/// Some rows of a rendering that have all their samples.
#[derive(Clone, Debug)]
pub struct Band {
    /// Their sequences, with the side channels that were asked for.
    pub rows: SequenceBatch,
    /// When the last of their samples was traced.
    pub traced: Instant,
}

/// Takes finished rows while others are still traced.
pub struct Consumer<'a> {
    /// The side channels that it reads; of those, it gets what follows from the sums.
    pub sides: Vec<Side>,
    /// Is called with rows of tiles, sixteen rows of pixels each, from the top, on a thread of
    /// its own that no tracing waits for: what is done there with all threads is done by this
    /// one. It gets no more rows once everything is traced, nor any of a rendering that was
    /// stopped early; the rows that it did not get are the caller's to do.
    pub take: &'a mut (dyn FnMut(Band) + Send),
}

/// The tiles of a row that are traced, in any order.
type Row<'f> = Vec<(Tile, TileFilm<'f>)>;

/// Calls `trace` for all tiles of a picture, from the top, and hands them on. Pixels have this
/// many samples then.
pub(crate) fn trace_and_hand<'f>(
    mut tiles: Vec<(Tile, TileFilm<'f>)>,
    [width, height]: [u32; 2],
    samples: u32,
    consumer: &mut Consumer<'_>,
    trace: impl Fn(&Tile, &mut TileFilm<'f>) + Sync,
) {
    // A pool of one thread: in the pool of the tracers, its work would wait for theirs.
    let Ok(thread) = ThreadPoolBuilder::new().num_threads(1).build() else {
        tiles.par_iter_mut().with_max_len(1).for_each(|(tile, film)| trace(tile, film));
        return;
    };
    tiles.sort_by_key(|(tile, _)| (tile.y, tile.x));
    let across = width.div_ceil(TILE) as usize;
    let rows: Vec<Mutex<Row<'f>>> = (0..height.div_ceil(TILE)).map(|_| Mutex::default()).collect();
    let all_traced = AtomicBool::new(false);
    thread.in_place_scope(|scope| {
        let (sender, receiver) = channel();
        let all_traced = &all_traced;
        scope.spawn(move |_| hand(receiver, width, samples, consumer, all_traced));
        // One by one, in this order.
        tiles.into_iter().par_bridge().for_each(|(tile, mut film)| {
            trace(&tile, &mut film);
            let number = tile.y / TILE;
            let mut row = rows[number as usize].lock().unwrap_or_else(PoisonError::into_inner);
            row.push((tile, film));
            if row.len() == across {
                // Nobody receives it if the consumer has panicked; the scope passes that on.
                let _ = sender.send((number, mem::take(&mut *row), Instant::now()));
            }
        });
        all_traced.store(true, Ordering::Relaxed);
    });
}

/// Gives rows of tiles to the consumer, in their order, until everything is traced.
fn hand(
    receiver: Receiver<(u32, Row<'_>, Instant)>,
    width: u32,
    samples: u32,
    consumer: &mut Consumer<'_>,
    all_traced: &AtomicBool,
) {
    let mut waiting = BTreeMap::new();
    let mut next = 0;
    for (number, row, traced) in receiver {
        waiting.insert(number, (row, traced));
        while let Some((mut row, traced)) = waiting.remove(&next) {
            if all_traced.load(Ordering::Relaxed) {
                return;
            }
            row.sort_by_key(|(tile, _)| tile.x);
            let (first, film) = &row[0];
            let strip = Strip {
                rows: first.y..first.y + first.height,
                width,
                slots: film.slots,
                samples,
                powers: FurtherPowers::of(&film.powers),
                tiles: row.iter().map(|(tile, film)| film.view(*tile)).collect(),
            };
            let rows = strip.batch([0; 2], &consumer.sides, &mut Buffers::default());
            (consumer.take)(Band { rows, traced });
            next += 1;
        }
    }
}
