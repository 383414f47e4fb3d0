//! Items in order of a number of theirs, where those of equal numbers stay as they were; places in what is sorted; the ends of
//! some numbers.

/// The smallest number first.
pub fn smallest_first<T>(items: &mut Vec<T>, number: impl Fn(&T) -> f64) {
    let numbers: Vec<f64> = items.iter().map(number).collect();
    arrange(items, ascending(&numbers));
}

/// The largest number first.
pub fn largest_first<T>(items: &mut Vec<T>, number: impl Fn(&T) -> f64) {
    smallest_first(items, |item| -number(item));
}

/// Smallest and largest of some numbers; +∞ and −∞ of none.
pub fn extent(numbers: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let nothing = (f64::INFINITY, f64::NEG_INFINITY);
    (numbers.into_iter()).fold(nothing, |(low, high), own| (low.min(own), high.max(own)))
}

/// Sorts places, not items: the sort is compiled once and not for every kind of item.
fn ascending(numbers: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..numbers.len()).collect();
    order.sort_by(|&a, &b| numbers[a].total_cmp(&numbers[b]));
    order
}

/// Place of an item in a sorted list that holds it. Another place would be a derivative by another unknown, unnoticed.
///
/// # Panics
/// The list lacks the item: whoever built the list left out what it was built for.
pub(crate) fn place<T: Ord>(sorted: &[T], item: &T) -> usize {
    let found = sorted.binary_search(item);
    found.expect("a list of places holds all whose places are asked for")
}

fn arrange<T>(items: &mut Vec<T>, order: Vec<usize>) {
    let mut left: Vec<Option<T>> = items.drain(..).map(Some).collect();
    items.extend(order.into_iter().filter_map(|place| left[place].take()));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[should_panic(expected = "holds all whose places")]
    fn what_is_not_there_has_no_place() {
        assert_eq!(place(&[1, 4, 6], &4), 1);
        place(&[1, 4, 6], &5);
    }

    #[test]
    fn equal_numbers_stay_in_order() {
        let of = [(2.0, 'a'), (-1.0, 'b'), (2.0, 'c'), (f64::INFINITY, 'd')];
        let names = |items: &[(f64, char)]| items.iter().map(|item| item.1).collect::<String>();
        let mut items = of.to_vec();
        smallest_first(&mut items, |item| item.0);
        assert_eq!(names(&items), "bacd");
        let mut items = of.to_vec();
        largest_first(&mut items, |item| item.0);
        assert_eq!(names(&items), "dacb");
    }
}
