//! Derivatives of residuals by the targets of effects, from the generated equations.

use nalgebra::DMatrix;
use tau_codegen::language::model as language;
use tau_codegen::language::model::{Model, Place, Subject, Target};
use tau_estimation::calibration::{Error, Nominal};
use tau_estimation::joint::Joint;
use tau_estimation::joint::variant::{PosesOf, add, additive, cart, free_turning, of_plate};
use tau_estimation::samples::Sample;
use tau_estimation::unknown_poses::rounds;
use tau_kinematics::Machine;
use tau_robot::robot::{Arm, Variant};
use tau_robot::robot_file::Noise;
use tau_runtime::{Owner, ResidualKind};

/// Derivatives of all rows, in units of the stated noise, by what effects may add to.
pub(super) struct Probes {
    pub(super) all: Vec<Probe>,
    /// Per track, indices of along, horizontal, vertical, roll, pitch, yaw.
    pub(super) carts: Vec<[usize; 6]>,
    /// Per link, or per cluster where the arm is reduced.
    pub(super) closures: Vec<ClosureProbe>,
    /// Of the measured TCP position x, y, z.
    pub(super) tcp: [usize; 3],
    /// Probe of each command that moves a crank or a link's length.
    pub(super) commands: Vec<Option<usize>>,
    /// Probes of joints on the base and of centres of cranks.
    pub(super) bases: Vec<BaseProbe>,
    /// Number of rows.
    pub(super) row_count: usize,
}

/// Derivatives by one displacement.
pub(super) struct Probe {
    /// Samples that it can act on.
    pub(super) samples: Vec<usize>,
    /// Rows of these samples that it moves, in order.
    pub(super) rows: Vec<Moved>,
}

/// A row that a probe moves; once for each sample that has a share in it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Moved {
    pub(super) row: usize,
    /// Place of the row's sample among those of the probe.
    pub(super) place: usize,
    pub(super) derivative: f64,
}

impl Probe {
    /// `rows` are the sample and the derivative of every row.
    pub(super) fn new(samples: Vec<usize>, rows: impl Iterator<Item = (usize, f64)>) -> Self {
        let rows = rows.enumerate();
        Self::of_rows(
            samples,
            rows.map(|(row, (sample, derivative))| (row, sample, derivative)),
        )
    }

    /// `rows` are derivatives of rows, in order, by what samples do.
    fn of_rows(samples: Vec<usize>, rows: impl Iterator<Item = (usize, usize, f64)>) -> Self {
        let last = samples.iter().max().map_or(0, |last| last + 1);
        let mut places = vec![None; last];
        for (place, &sample) in samples.iter().enumerate() {
            places[sample] = Some(place);
        }
        let moved = |(row, sample, derivative): (usize, usize, f64)| {
            let place = places.get(sample).copied().flatten()?;
            (derivative != 0.0).then_some(Moved {
                row,
                place,
                derivative,
            })
        };
        Self {
            rows: rows.filter_map(moved).collect(),
            samples,
        }
    }
}

/// Indices of the probes of a link's length and plate joint.
pub(super) struct ClosureProbe {
    pub(super) cluster: usize,
    /// `None` where the arm is reduced.
    pub(super) link: Option<usize>,
    /// The command that its cart, or its length, follows.
    pub(super) command: Option<usize>,
    /// At each sample.
    pub(super) lengths_m: Vec<f64>,
    /// At command zero.
    pub(super) length_at_zero_m: f64,
    pub(super) length: usize,
    /// `None` where the arm is reduced, or links meet in a point.
    pub(super) joint: Option<[usize; 3]>,
}

/// Indices of the probes of a joint on the base, or of the centre of a crank, along x, y, z.
pub(super) struct BaseProbe {
    pub(super) place: Place,
    /// Link, cluster of a reduced arm or crank.
    pub(super) owner: Owner,
    /// The command of the crank or of the link, where it has one.
    pub(super) command: Option<usize>,
    /// Where it is, without effects (m).
    pub(super) at_m: [f64; 3],
    pub(super) shift: [usize; 3],
}

impl ClosureProbe {
    /// The link, or the cluster of a reduced arm.
    pub(super) fn owner(&self) -> Owner {
        self.link.map_or(Owner::Cluster(self.cluster), Owner::Link)
    }
}

/// Targets of a cart's probe, in its order.
pub(super) const TARGETS_OF_CART: [Target; 6] = [
    Target::Along,
    Target::Horizontal,
    Target::Vertical,
    Target::Roll,
    Target::Pitch,
    Target::Yaw,
];

/// The variant (by index in the model) with a constant added to every target: the derivatives by these are
/// those of the targets.
pub(super) fn compiled(model: &Model, variant: usize, poses: PosesOf) -> Variant {
    let mut probed = model.clone();
    let targets = TARGETS_OF_CART.map(|target| (target, None));
    let of_cart = additive("unnamed_probe_cart", Subject::Cart, &targets, None);
    let of_tcp = additive(
        "unnamed_probe_tcp",
        Subject::Tcp,
        &[(Target::Position, None)],
        None,
    );
    add(
        &mut probed,
        variant,
        of_cart,
        (0..model.tracks.len()).map(cart),
    );
    add(&mut probed, variant, of_tcp, std::iter::once(Place::Tcp));
    // Lengths and joints may be formulas or held, so that no parameter stands for them; a reduced arm has one length a
    // cluster, which is one.
    if probed.variants[variant].arm == language::Arm::Full {
        let targets = [(Target::Length, None), (Target::Joint, None)];
        let targets = &targets[..if model.plate.is_point() { 1 } else { 2 }];
        let of_link = additive("unnamed_probe_link", Subject::Link, targets, None);
        let links = (0..model.links.len()).map(Place::Link);
        add(&mut probed, variant, of_link, links);
    }
    for (subject, places) in of_drives(model) {
        let name = format!("unnamed_probe_{}", subject.written().replace(' ', "_"));
        let own = additive(&name, subject, &[(Target::Command, None)], None);
        let places = places.into_iter().map(|(place, _)| place);
        add(&mut probed, variant, own, places);
    }
    let of_base = [(Target::Shift, None)];
    let of_base = additive(
        "unnamed_probe_base_joint",
        Subject::BaseJoint,
        &of_base,
        None,
    );
    let bases = bases(model, probed.variants[variant].arm);
    add(&mut probed, variant, of_base, bases.into_iter());
    let closures = of_plate(&probed, variant, poses, |kind, _| {
        kind != ResidualKind::ClosureByPose
    });
    free_turning(&probed, variant, Some(&closures), poses)
}

/// Places at which a drive may add to its command, with the command.
type Driven = Vec<(Place, usize)>;

/// Drives that are no tracks, by what effects on them act on.
fn of_drives(model: &Model) -> [(Subject, Driven); 3] {
    let links = |subject: Subject| {
        let links = model.links.iter().enumerate();
        let own = links.filter(|(_, link)| subject.admits(link));
        own.filter_map(|(index, link)| Some((Place::Link(index), link.actuated_by?)))
            .collect()
    };
    let cranks = model.cranks().map(|track| (Place::Crank(track), track));
    [
        (Subject::Crank, cranks.collect()),
        (Subject::LinkByLength, links(Subject::LinkByLength)),
        (Subject::LinkByAngle, links(Subject::LinkByAngle)),
    ]
}

/// Places whose shifts differ: a reduced arm has one joint a cluster.
fn bases(model: &Model, arm: language::Arm) -> Vec<Place> {
    let is_first = |link: &usize| {
        let cluster = model.links_of_cluster(model.links[*link].cluster);
        arm == language::Arm::Full || cluster.first() == Some(link)
    };
    let joints = model.links_on_base().filter(is_first).map(Place::BaseJoint);
    model
        .cranks()
        .map(Place::CrankCentre)
        .chain(joints)
        .collect()
}

impl Probes {
    /// At the values of a fit of a base with `first` effects; `compiled` is the base with a constant
    /// added to every target, its closures functions of these poses.
    pub(super) fn of(
        model: &Model,
        first: usize,
        (compiled, poses): (Variant, PosesOf),
        base: &Joint,
        fitted: &[f64],
        samples: &[Sample],
        noise: Noise,
    ) -> Result<Self, Error> {
        let machine = with_targets(compiled, base, fitted);
        let without_prior = |&value: &f64| Nominal::new(value, None);
        let nominal: Vec<Nominal> = machine.values.iter().map(without_prior).collect();
        let joint = if base.eliminated.is_empty() {
            Joint::new(machine, &nominal, samples, noise)?
        } else {
            Joint::of_unknown_poses(machine, &nominal, samples, noise, &base.eliminated, &[])?
        };
        let factors = vec![1.0; joint.rows.len()];
        let linear = joint.linearize(&joint.fitted(&joint.machine.values), &factors);
        let closures = (!joint.eliminated.is_empty())
            .then(|| rounds::closure_derivatives(&joint.machine, samples))
            .transpose()?;
        let mut columns = Columns {
            closures,
            joint: &joint,
            jacobian: &linear.jacobian.dense(),
            samples,
            all: Vec::new(),
        };
        let tracks = model.tracks.len();
        let carts = (0..tracks)
            .map(|track| {
                let owner = Owner::Effect(first + track);
                TARGETS_OF_CART.map(|target| {
                    columns.add((owner, target.name(), None), &|sample| {
                        sample.track.is_none_or(|own| own == track)
                    })
                })
            })
            .collect();
        let shift = Owner::Effect(first + tracks);
        let position = Target::Position.name();
        let tcp = [0, 1, 2].map(|axis| {
            if poses == PosesOf::Machine {
                return columns.of_tracker(axis);
            }
            columns.add((shift, position, Some(axis)), &is_of_set_1)
        });
        let mut effect = first + tracks + 1;
        let closures = columns.closures(model, effect);
        let arm = arm_of(&joint.machine.variant);
        if arm == language::Arm::Full {
            effect += model.links.len();
        }
        let mut commands = vec![None; model.commands()];
        for (_, command) in of_drives(model).into_iter().flat_map(|(_, own)| own) {
            let owner = Owner::Effect(effect);
            let of_drive = (owner, Target::Command.name(), None);
            commands[command] = Some(columns.add(of_drive, &is_of_set_1));
            effect += 1;
        }
        let bases = bases(model, arm).into_iter().zip(effect..);
        let bases = bases
            .map(|(place, effect)| columns.base(model, place, effect))
            .collect();
        Ok(Self {
            all: columns.all,
            carts,
            closures,
            tcp,
            commands,
            bases,
            row_count: joint.rows.len(),
        })
    }
}

fn arm_of(variant: &Variant) -> language::Arm {
    match variant.arm {
        Arm::Full => language::Arm::Full,
        Arm::Reduced => language::Arm::Reduced,
    }
}

fn is_of_set_1(sample: &Sample) -> bool {
    sample.set == 1
}

/// A base as fitted, with the constants on its targets at zero.
fn with_targets(mut compiled: Variant, base: &Joint, fitted: &[f64]) -> Machine {
    let base_variant = &base.machine.variant;
    let own = |name: &str| base_variant.parameters.iter().position(|p| p.name == name);
    let by_name = |values: &[f64]| -> Vec<f64> {
        let names = compiled.parameters.iter().map(|own| own.name.as_str());
        let of = |name| own(name).and_then(|index| values.get(index).copied());
        names.map(|name| of(name).unwrap_or(0.0)).collect()
    };
    let values = by_name(&base.values(fitted));
    let mut surroundings = base.machine.surroundings.clone();
    surroundings.held = by_name(&surroundings.held);
    // The whitening needs closures by pose, which the base has.
    let index = |of: usize| compiled.index_of(&base_variant.parameters[of].name);
    let of_base = base.machine.closure_instances();
    let by_pose: Vec<_> = of_base.map(|own| own.renumbered(index)).collect();
    compiled
        .instances
        .retain(|instance| instance.kind != ResidualKind::ClosureByPose);
    compiled.instances.extend(by_pose);
    Machine {
        robot: base.machine.robot.clone(),
        variant: compiled,
        values,
        surroundings,
    }
}

/// Columns of a Jacobian that become probes.
struct Columns<'a> {
    /// Where poses are unknown: derivatives of the closures of each sample by the parameters of the variant.
    closures: Option<Vec<DMatrix<f64>>>,
    joint: &'a Joint,
    jacobian: &'a DMatrix<f64>,
    samples: &'a [Sample],
    all: Vec<Probe>,
}

impl Columns<'_> {
    /// A probe of a parameter (owner, quantity, component) over the samples on which it acts; its index.
    fn add(
        &mut self,
        (owner, quantity, component): (Owner, &str, Option<usize>),
        acts_on: &dyn Fn(&Sample) -> bool,
    ) -> usize {
        let index = self
            .joint
            .machine
            .variant
            .parameter(owner, quantity, component);
        let column = index.and_then(|index| self.joint.used.binary_search(&index).ok());
        let samples = (0..self.samples.len())
            .filter(|&s| acts_on(&self.samples[s]))
            .collect();
        if let Some(closures) = &self.closures {
            let moved = index.map_or_else(Vec::new, |index| self.of_eliminated(closures, index));
            self.all.push(Probe::of_rows(samples, moved.into_iter()));
            return self.all.len() - 1;
        }
        let of_rows = self.joint.rows.iter().map(|row| row.sample);
        let rows = self.jacobian.nrows();
        let of_column =
            |column: usize| &self.jacobian.as_slice()[column * rows..(column + 1) * rows];
        let derivatives = column.map_or(&[][..], of_column).iter().copied();
        self.all.push(Probe::new(samples, of_rows.zip(derivatives)));
        self.all.len() - 1
    }

    /// Derivatives of rows by what a parameter (index in the variant) does to the closures of each sample.
    fn of_eliminated(
        &self,
        closures: &[DMatrix<f64>],
        parameter: usize,
    ) -> Vec<(usize, usize, f64)> {
        let (mut moved, mut first) = (Vec::new(), 0);
        for group in &self.joint.eliminated {
            let rows = group.by_closure.nrows();
            for row in 0..rows {
                for (place, &sample) in group.samples.iter().enumerate() {
                    let own = closures[sample].column(parameter);
                    let shares = group.by_closure.row(row);
                    let shares = shares.columns(place * own.len(), own.len());
                    moved.push((first + row, sample, shares.tr_dot(&own)));
                }
            }
            first += rows;
        }
        // Behind them come the rows of carts.
        if let Ok(column) = self.joint.used.binary_search(&parameter) {
            let rest = (first..self.joint.rows.len()).map(|row| {
                (
                    row,
                    self.joint.rows[row].sample,
                    self.jacobian[(row, column)],
                )
            });
            moved.extend(rest);
        }
        moved
    }

    /// A probe of what a tracker measured along an axis; its index.
    fn of_tracker(&mut self, axis: usize) -> usize {
        let (mut moved, mut first) = (Vec::new(), 0);
        for group in &self.joint.eliminated {
            for row in 0..group.by_tracker.nrows() {
                let tracked = group.tracked.iter().enumerate();
                moved.extend(tracked.map(|(place, tracked)| {
                    let share = group.by_tracker[(row, 3 * place + axis)];
                    (first + row, tracked.sample, share)
                }));
            }
            first += group.by_tracker.nrows();
        }
        let samples = self.samples.iter().enumerate();
        let of_plate = samples.filter(|(_, sample)| is_of_set_1(sample));
        let of_plate = of_plate.map(|(index, _)| index).collect();
        self.all.push(Probe::of_rows(of_plate, moved.into_iter()));
        self.all.len() - 1
    }

    /// Shifts of a joint on the base or of the centre of a crank, at which the effect of an index acts.
    fn base(&mut self, model: &Model, place: Place, effect: usize) -> BaseProbe {
        let machine = &self.joint.machine;
        let joint_m = |of: usize| {
            let mut closures = machine.closure_instances();
            let own = closures.find(|closure| closure.of == of);
            own.map_or([f64::NAN; 3], |own| machine.base_joint_m(own))
        };
        let (owner, command, at_m) = match place {
            Place::CrankCentre(track) => {
                let centre_m = machine.crank_centre_m(track);
                (
                    Owner::Crank(track),
                    Some(track),
                    centre_m.unwrap_or([f64::NAN; 3]),
                )
            }
            Place::BaseJoint(link) if machine.variant.arm == Arm::Reduced => {
                let cluster = model.links[link].cluster;
                (
                    Owner::Cluster(cluster),
                    model.command_of(link),
                    joint_m(cluster),
                )
            }
            Place::BaseJoint(link) => (Owner::Link(link), model.command_of(link), joint_m(link)),
            _ => unreachable!("bases are joints of links and centres of cranks"),
        };
        let target = Target::Shift.name();
        let shift = [0, 1, 2]
            .map(|axis| self.add((Owner::Effect(effect), target, Some(axis)), &is_of_set_1));
        BaseProbe {
            place,
            owner,
            command,
            at_m,
            shift,
        }
    }

    /// Lengths and joints of the links, the first of which has the effect of an index; or lengths of the clusters where
    /// the arm is reduced.
    fn closures(&mut self, model: &Model, first: usize) -> Vec<ClosureProbe> {
        let machine = &self.joint.machine;
        let by_pose: Vec<_> = machine.closure_instances().collect();
        let has_joints = !model.plate.is_point();
        let mut probe = |closure: usize, cluster: usize, link: Option<usize>| {
            let owner = match link {
                Some(link) => Owner::Effect(first + link),
                None => Owner::Cluster(cluster),
            };
            let own = by_pose.iter().find(|instance| instance.of == closure);
            let length = |sample: &Sample| {
                own.map_or(f64::NAN, |own| machine.length_m(own, &sample.commands_m))
            };
            let joint = Target::Joint.name();
            ClosureProbe {
                cluster,
                link,
                command: model.clusters[cluster]
                    .track
                    .or(link.and_then(|link| model.links[link].actuated_by)),
                lengths_m: self.samples.iter().map(length).collect(),
                length_at_zero_m: own.map_or(f64::NAN, |own| {
                    machine.length_m(own, &vec![0.0; machine.robot.commands])
                }),
                length: self.add((owner, Target::Length.name(), None), &is_of_set_1),
                joint: link
                    .filter(|_| has_joints)
                    .map(|_| [0, 1, 2].map(|k| self.add((owner, joint, Some(k)), &is_of_set_1))),
            }
        };
        match machine.variant.arm {
            Arm::Full => (0..model.links.len())
                .map(|link| probe(link, model.links[link].cluster, Some(link)))
                .collect(),
            Arm::Reduced => (0..model.clusters.len())
                .map(|cluster| probe(cluster, cluster, None))
                .collect(),
        }
    }
}
