//! The constants of the decision, in one place, so that each can be scaled to see what it does.

macro_rules! constants {
    ($($(#[doc = $doc:literal])+ $name:ident: $default:expr;)+) => {
        /// The constants of the decision. `docs/discovery-benchmark.md` shows what scaling some of them does.
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct Constants {
            $($(#[doc = $doc])+ pub $name: f64,)+
        }

        impl Default for Constants {
            fn default() -> Self {
                Self { $($name: $default,)+ }
            }
        }

        impl Constants {
            /// Name, value and reason of each.
            pub fn table(&self) -> Vec<(&'static str, f64, &'static str)> {
                vec![$((stringify!($name), self.$name, concat!($($doc),+)),)+]
            }

            /// A constant by its name.
            pub fn by_name(&mut self, name: &str) -> Option<&mut f64> {
                match name {
                    $(stringify!($name) => Some(&mut self.$name),)+
                    _ => None,
                }
            }
        }
    };
}

constants! {
    /// Family-wise level of the first effect: the chance of any where nothing is missing (convention).
    level: 0.05;
    /// Ratio of prior odds between one effect and one more: machines with several faults are rarer.
    further: 0.1;
    /// Share of the level that all names have together; unnamed families are many and have the rest.
    share_of_names: 0.8;
    /// Fall of −2 ln L within which two models fit as well: odds of twenty to one.
    as_good: 6.0;
    /// Level at which structure is looked for where a found effect acts, among the families that act there alone.
    left_where_found: 0.005;
    /// An effect that has to exceed its tolerance so many times to be seen is no candidate.
    implausible: 10.0;
    /// Share of a signal's energy that the base must leave; less is of the size of what closures bend.
    absorbed: 1e-5;
    /// Power at which an amplitude counts as detectable (Baarda's convention).
    power: 0.8;
    /// Standard deviations by which residuals must follow each other before their noise counts as serial.
    serial: 2.0;
    /// Blocks of neighbours that are held out in turn, per set and cart.
    folds: 8.0;
    /// Quantile of the resampled held-out gain that has to be above zero: one standard deviation.
    lower: 0.16;
    /// Noise that is so many times the stated one counts as structure.
    far_beyond: 2.0;
}
