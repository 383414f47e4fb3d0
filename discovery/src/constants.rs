//! The constants of the decision, in one place, so that each can be scaled to see what it does.

pub(crate) use tau_estimation::numerics::count;

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
    /// Ratio of prior odds between one effect, wherever it acts, and one more: machines with several faults are rarer.
    further: 0.1;
    /// Share of the level that all names have together; unnamed families are many and have the rest.
    share_of_names: 0.8;
    /// Fall of −2 ln L within which two models fit as well: three standard deviations, since each is compared with many.
    as_good: 9.0;
    /// Level at which structure is looked for where a found effect acts, among the families that act there alone.
    left_where_found: 0.005;
    /// An effect that has to exceed its tolerance so many times to be seen is no candidate.
    implausible: 10.0;
    /// Share of a signal's energy that the base must leave; less is of the size of what closures bend.
    absorbed: 1e-5;
    /// Power at which an amplitude counts as detectable (Baarda's convention).
    power: 0.8;
    /// Standard deviations by which residuals must follow each other before their noise counts as serial, or readings of a
    /// visit agree before it counts as shared.
    serial: 2.0;
    /// Blocks of neighbours that are held out in turn, per set and cart.
    folds: 8.0;
    /// Quantile of the resampled held-out gain that has to be above zero: one standard deviation.
    lower: 0.16;
    /// Chance that measurements which took no part reject an effect that is real.
    contradicted: 0.01;
    /// Most effects and families of a model: machines have fewer, and a base that lacks more is another machine's.
    most_effects: 10.0;
    /// Highest harmonic of a found period that is looked at: of gears and racks the first few are strong.
    harmonics: 4.0;
    /// Triangles by which a family follows a track piece by piece: the first bend that polynomials miss.
    triangles: 9.0;
    /// Most knots with which a straight track is tested: cost grows with the square of their number, and structure of a
    /// track runs over more than one in so many.
    knots: 64.0;
    /// Strongest correlation of serial noise that is believed: beyond it noise is drift.
    strongest_serial: 0.95;
    /// Square of the cosine from which a rival's signal is the effect's own, and only a refit tells whether it explains
    /// as much: the derivatives of both bend by more than noise where an effect is strong.
    alike: 0.99;
    /// Searches where poses are unknown, each with the noise and without the gross measurements that the machine found
    /// before shows; two are usual.
    searches: 3.0;
    /// Most poses of a search, evenly spread over those that calibrate: more take 0.2 MB each where they were measured, a
    /// third of it where not, and show effects of less than an eighth of the noise.
    most_poses: 2000.0;
    /// Change of an estimated standard deviation, as a share, from which such a search is worth repeating: scores, which
    /// go with its square, change by a tenth.
    other_noise: 0.05;
}
