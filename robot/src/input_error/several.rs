//! Errors of several sources, reported together.

use super::InputError;

/// Collects the errors of several sources.
#[derive(Debug, Default)]
pub struct Errors(Option<InputError>);

impl Errors {
    /// One error more.
    pub fn add(&mut self, error: InputError) {
        self.0 = Some(match self.0.take() {
            Some(earlier) => earlier.and(error),
            None => error,
        });
    }

    /// The value, or a stand-in for it and one error more.
    pub fn keep<T: Default>(&mut self, result: Result<T, InputError>) -> T {
        result.unwrap_or_else(|error| {
            self.add(error);
            T::default()
        })
    }

    /// All errors, or nothing where there are none.
    pub fn finish(self) -> Result<(), InputError> {
        self.0.map_or(Ok(()), Err)
    }
}

/// Both values, or the mistakes of both.
///
/// # Errors
/// Either is one.
pub fn both<A, B>(
    a: Result<A, InputError>,
    b: Result<B, InputError>,
) -> Result<(A, B), InputError> {
    match (a, b) {
        (Ok(a), Ok(b)) => Ok((a, b)),
        (Err(a), Err(b)) => Err(a.and(b)),
        (Err(error), Ok(_)) | (Ok(_), Err(error)) => Err(error),
    }
}
