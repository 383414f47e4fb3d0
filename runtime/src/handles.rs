//! Typed handles of a declared robot's variants and parameters.
//!
//! Generated code declares a constant for each, so that a name that is misspelt, and a handle of another
//! robot, do not compile. A handle is an index and a type.

use core::fmt;
use core::hash::{Hash, Hasher};
use core::marker::PhantomData;

use crate::{Parameter, Robot, Variant};

/// A robot whose description was compiled: what `tau_model!` and `tau generate` declare.
pub trait DeclaredRobot: 'static {
    /// The robot's structure and its variants, with their generated functions.
    const ROBOT: &'static Robot;
}

/// A variant of the robot `R`, such as `Gantry::RUNOUT`.
pub struct VariantHandle<R> {
    index: usize,
    robot: PhantomData<fn() -> R>,
}

/// A parameter of a variant of the robot `R`, such as `gantry::runout::RUNOUT_TWO_PERIOD`.
pub struct ParameterHandle<R> {
    variant: VariantHandle<R>,
    index: usize,
}

impl<R: DeclaredRobot> VariantHandle<R> {
    /// The variant at an index; for generated code, which names it.
    ///
    /// # Panics
    /// Where the robot has no such variant: in a constant, when it is compiled.
    pub const fn new(index: usize) -> Self {
        assert!(index < R::ROBOT.variants.len(), "no such variant");
        Self {
            index,
            robot: PhantomData,
        }
    }

    /// Index in [`Robot::variants`].
    pub const fn index(self) -> usize {
        self.index
    }

    /// The variant's tables.
    pub const fn table(self) -> &'static Variant {
        &R::ROBOT.variants[self.index]
    }

    /// Name in the description, such as `Runout`.
    pub const fn name(self) -> &'static str {
        self.table().name
    }
}

impl<R: DeclaredRobot> ParameterHandle<R> {
    /// The parameter at an index of the variant at an index; for generated code, which names it.
    ///
    /// # Panics
    /// Where the variant has no such parameter: in a constant, when it is compiled.
    pub const fn new(variant: usize, index: usize) -> Self {
        let variant = VariantHandle::<R>::new(variant);
        let count = variant.table().parameters.len();
        assert!(index < count, "no such parameter");
        Self { variant, index }
    }

    /// The variant that the parameter belongs to.
    pub const fn variant(self) -> VariantHandle<R> {
        self.variant
    }

    /// Index in [`Variant::parameters`].
    pub const fn index(self) -> usize {
        self.index
    }

    /// The parameter's row of the table: unit, owner, values from the description.
    pub const fn table(self) -> &'static Parameter {
        &self.variant.table().parameters[self.index]
    }

    /// Full name, such as `runout(two).period`.
    pub const fn name(self) -> &'static str {
        self.table().name
    }
}

// Derived traits would ask the same of `R`.

impl<R> Clone for VariantHandle<R> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<R> Copy for VariantHandle<R> {}

impl<R> PartialEq for VariantHandle<R> {
    fn eq(&self, other: &Self) -> bool {
        self.index == other.index
    }
}

impl<R> Eq for VariantHandle<R> {}

impl<R> Hash for VariantHandle<R> {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.index.hash(state);
    }
}

impl<R: DeclaredRobot> fmt::Debug for VariantHandle<R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}::{}", R::ROBOT.name, self.name())
    }
}

impl<R> Clone for ParameterHandle<R> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<R> Copy for ParameterHandle<R> {}

impl<R> PartialEq for ParameterHandle<R> {
    fn eq(&self, other: &Self) -> bool {
        (self.variant, self.index) == (other.variant, other.index)
    }
}

impl<R> Eq for ParameterHandle<R> {}

impl<R> Hash for ParameterHandle<R> {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.variant.hash(state);
        self.index.hash(state);
    }
}

impl<R: DeclaredRobot> fmt::Debug for ParameterHandle<R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}::{}", self.variant, self.name())
    }
}
