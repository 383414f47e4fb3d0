//! Forces of the reference: linear in the pulls that are parameters.

use num_dual::Dual64;
use tau::robot::{Input, Owner};

use super::Reference;

impl Reference<'_> {
    pub(super) fn tension(&self, link: usize) -> Dual64 {
        let by_pull = |pulled| Input::TensionByPull { link, pulled };
        self.force(Input::Tension(link), by_pull)
    }

    pub(super) fn load(&self, track: usize, component: usize) -> Dual64 {
        let by_pull = |pulled| Input::LoadByPull {
            track,
            component,
            pulled,
        };
        self.force(Input::Load { track, component }, by_pull)
    }

    fn force(&self, stated: Input, by_pull: impl Fn(usize) -> Input) -> Dual64 {
        let links = self.model.links.iter().enumerate();
        let pulls = links
            .filter(|(_, link)| (link.pull.as_ref()).is_some_and(|pull| pull.tolerance.is_some()));
        pulls.fold(self.datum(stated), |force, (pulled, _)| {
            let pull = self.parameter(Owner::Link(pulled), "pull", None);
            force + (pull - self.datum(Input::Pull(pulled))) * self.datum(by_pull(pulled))
        })
    }
}
