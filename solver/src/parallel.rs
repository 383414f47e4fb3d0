//! The same work on many items, on all cores; results do not depend on how many there are.

use std::sync::Mutex;

use rayon::prelude::*;

/// Does work from within the pool of threads, where handing parts of it to the others costs next to nothing;
/// from outside, every part would wait for a thread to wake.
pub fn within<R: Send>(work: impl FnOnce() -> R + Send) -> R {
    rayon::scope(|_| work())
}

/// Both pieces of work, at once where a core is free.
pub fn both<A: Send, B: Send>(
    first: impl FnOnce() -> A + Send,
    second: impl FnOnce() -> B + Send,
) -> (A, B) {
    let (mut first, mut second) = (Piece::Open(first), Piece::Open(second));
    join(&mut || first.finish(), &mut || second.finish());
    (first.result(), second.result())
}

/// Results of `work` on each item, in order; each is handed out alone.
pub fn map<T: Sync, R: Send>(items: &[T], work: impl Fn(&T) -> R + Sync) -> Vec<R> {
    map_owned(items.iter().collect(), work)
}

/// The same of items that the work takes.
pub fn map_owned<T: Send, R: Send>(items: Vec<T>, work: impl Fn(T) -> R + Sync) -> Vec<R> {
    let work = &work;
    let pieces: Vec<_> = (items.into_iter())
        .map(|item| Mutex::new(Piece::Open(move || work(item))))
        .collect();
    each(pieces.len(), &|index| {
        pieces[index]
            .lock()
            .expect("no other thread has this piece")
            .finish();
    });
    (pieces.into_iter())
        .map(|piece| {
            piece
                .into_inner()
                .expect("a panic would have come through")
                .result()
        })
        .collect()
}

/// Work to do, or what came of it.
enum Piece<F, R> {
    Open(F),
    InHand,
    Done(R),
}

impl<F: FnOnce() -> R, R> Piece<F, R> {
    fn finish(&mut self) {
        if let Self::Open(work) = std::mem::replace(self, Self::InHand) {
            *self = Self::Done(work());
        }
    }

    fn result(self) -> R {
        match self {
            Self::Done(result) => result,
            _ => unreachable!("every piece is finished"),
        }
    }
}

// These two take work of any kind behind a pointer: what distributes it is compiled once. In its own copy for
// every closure it was a seventh of all code that the compiler was given.

fn join(first: &mut (dyn FnMut() + Send), second: &mut (dyn FnMut() + Send)) {
    rayon::join(first, second);
}

fn each(count: usize, work: &(dyn Fn(usize) + Sync)) {
    if count == 1 {
        // From outside the pool, a thread would have to wake for it.
        return work(0);
    }
    (0..count).into_par_iter().with_max_len(1).for_each(work);
}

#[cfg(test)]
mod tests {
    #[test]
    fn results_come_in_order() {
        let items: Vec<u64> = (0..100).collect();
        let squares = super::map(&items, |item| item * item);
        assert_eq!(
            squares,
            items.iter().map(|item| item * item).collect::<Vec<_>>()
        );
    }
}
