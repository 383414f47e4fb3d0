//! The method of a discovery, in words.

use maud::{Markup, html};
use tau::discovery::Discovery;
use tau::study::results::Setting;

use super::words;
use crate::findings;
use crate::number::general;

/// From the measurements to the verdict, step by step.
pub(crate) fn obtained(found: &Discovery, setting: &Setting) -> Markup {
    let base = &found.base;
    html! {
        p {
            (findings::measured(setting))
            @if found.validation.held_out {
                " What calibrates takes part in the search; what validates takes part in nothing and shows the "
                (found.validation.of.short()) "."
            } @else {
                " All of it takes part in the search."
            }
        }
        ol.steps {
            li {
                b { "Fit. " }
                @if setting.rows.is_some() {
                    (words::variant(&found.model, base)) " is fitted to all measurements of the plate at once, the pose behind each \
                     unknown, with the tolerances of the robot file as priors; poses are then where machine and measurements \
                     have them. "
                } @else if setting.architecture.carts > 0 {
                    (words::variant(&found.model, base)) " is fitted to all sets that there are at once: set 1 through the closure of its links, \
                     sets 2 and 3 through the motion of the carts, with the frames of the tracker and the places of the \
                     targets unknown and the tolerances of the robot file as priors. A study's table of errors fits set 1 \
                     alone, so that the error of " (base) " there is another one (here "
                    (general(found.validation.before.mean_um, 3)) " µm in the mean). "
                } @else {
                    (words::variant(&found.model, base)) " is fitted to the poses through the closure of its links, with the \
                     tolerances of the robot file as priors. "
                }
                "Outliers are left out first."
            }
            li {
                b { "Weigh. " }
                @if setting.rows.is_some() {
                    "What the motions of a pose could take up of its readings and measurements is taken away; what is left is \
                     weighed by the noise of each kind. "
                } @else {
                    "All closures of a pose share the noise of its position"
                    @if !setting.architecture.plate.turning_axes().is_empty() { " and rotation" }
                    ": they are whitened together. The size of the noise is estimated for each set. "
                }
                "What is called the stated noise is that of the robot file."
            }
            li {
                b { "Score. " }
                "Every effect of the catalogue at every place, and unnamed functions beside them, are scored by what the \
                 model leaves of their signal in the residuals (F test, where a parameter is searched over its whole \
                 range). What counts as significant holds over all candidates together: 5 % for the first name, 0.5 % for \
                 every further one."
            }
            li {
                b { "Search. " }
                "A model is scored by its misfit (−2 ln L, the noise of each set estimated) and by what its effects cost: \
                 each as much as the fall at which it is just significant. From the base, effects join, leave and take \
                 the place of others, at one place, at several or at all in common, as long as the score gets better \
                 once all parameters have been fitted anew. No model is tried twice, and the best of all that were \
                 tried is the answer."
            }
            li {
                b { "Confirm. " }
                "What joins has to be more than noise that follows itself in time would imitate, and has to predict blocks \
                 of neighbouring poses and points that are held out. Their noise, the outliers among them and the period \
                 of what repeats are known from all blocks."
            }
            li {
                b { "Look again. " }
                "In the end each effect is tested beside all others, with what could be meant instead; and where effects \
                 act, structure that is left is looked for at 0.5 %."
            }
        }
    }
}
