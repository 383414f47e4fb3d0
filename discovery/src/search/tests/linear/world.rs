//! The problem as a search sees it: a robot, a catalogue, rows and what carts do to them.

use super::*;

/// Everything of a search that is no linear algebra.
pub(super) struct World {
    robot: Robot,
    model: Model,
    file: RobotFile,
    folder: Folder,
    division: Division,
    options: Options,
    families: usize,
}

impl World {
    pub(super) fn new(families: &str) -> Self {
        let robot = Robot::from_text(DESCRIPTION).unwrap();
        let base = check_text(DESCRIPTION).unwrap();
        let catalogue = format!("{CATALOGUE}{families}");
        let pose = |row: usize| {
            let (_, q, side) = at(row);
            TcpPose {
                pose: row as u32,
                line: row + 2,
                commands_m: vec![q; 3],
                position_m: [0.0; 3],
                angles_rad: [0.0; 3],
                conditions: Conditions::default(),
                directions: Some(vec![side; 3]),
                tensions_n: None,
                sigmas: PoseSigmas::default(),
            }
        };
        Self {
            file: RobotFile::parse_for(&robot_file(), "robot.toml", &robot).unwrap(),
            robot,
            model: effects_from_text(&catalogue, &base).unwrap(),
            folder: Folder {
                tcp_poses: (0..ROWS).map(pose).collect(),
                ..Folder::default()
            },
            division: Division {
                calibration: (0..ROWS).collect(),
                validation: vec![],
            },
            options: Options::default(),
            families: usize::from(!families.is_empty()),
        }
    }

    pub(super) fn input(&self) -> Input<'_> {
        Input {
            robot: &self.robot,
            model: &self.model,
            base: "Plain",
            file: &self.file,
            folder: &self.folder,
            division: &self.division,
            unknown: None,
            options: &self.options,
        }
    }

    fn samples(&self) -> Vec<Sample> {
        let poses = &self.division.calibration;
        Sample::all(&self.robot, &self.folder, poses, &Frames::default())
    }

    /// The effects and families of a search at a model that has some of them, fitted to measured rows.
    pub(super) fn search<'a>(
        &self,
        input: &'a Input<'a>,
        rows: &DVector<f64>,
        members: &[Used],
    ) -> Search<'a> {
        let fit = self.fit(rows, &[], None);
        let set = self.set(&fit);
        let candidates: Vec<Member> = (members.iter())
            .map(|used| Member {
                candidate: candidate(&set, used.name, used.place),
                extended: used.columns.len() > 1,
            })
            .collect();
        let base = State {
            fit,
            members: vec![],
            unnamed: vec![],
        };
        let fitted = State {
            fit: self.fit(rows, members, Some((&set, &candidates))),
            members: candidates,
            unnamed: vec![],
        };
        let first = set.table(&base.linear(&set));
        let likelihood = ProfileLikelihood::of(&base.fit, &set.samples);
        Search::at(input, (set, &first), (0, 0), (base, fitted), likelihood)
    }

    fn set(&self, fit: &Fit) -> CandidateSet {
        let families = vec![
            Family {
                against: vec![Readable::Command],
                placement: Placement::Single,
            };
            self.families
        ];
        let probes = Probes {
            all: (0..18).map(probe).collect(),
            carts: (0..3)
                .map(|cart| [0, 1, 2, 3, 4, 5].map(|axis| 6 * cart + axis))
                .collect(),
            closures: vec![],
            tcp: [0; 3],
            commands: vec![],
            bases: vec![],
            row_count: ROWS,
        };
        let context = (fit, &self.options);
        let variant = &fit.joint.machine.variant;
        let (model, samples) = (self.model.clone(), self.samples());
        CandidateSet::new(model, variant, &families, samples, probes, context, None)
    }

    /// A model fitted to measured rows: the offsets, and effects.
    fn fit(
        &self,
        rows: &DVector<f64>,
        members: &[Used],
        candidates: Option<(&CandidateSet, &[Member])>,
    ) -> Fit {
        let mut model = self.model.clone();
        if let Some((set, candidates)) = candidates {
            let used = candidates
                .iter()
                .map(|member| set.candidates[member.candidate].used(&model, member.extended, 1.0));
            let used: Vec<_> = used.collect();
            model.variants[0].effects = used;
        }
        let variant = Variant::from(&compile_some(&model, 0, |_, _| false));
        let is_wanted = |parameter: &Parameter| match parameter.owner {
            Owner::Cluster(_) => parameter.quantity == "length",
            Owner::Effect(_) => true,
            _ => false,
        };
        let wanted = |&index: &usize| is_wanted(&variant.parameters[index]);
        let used: Vec<usize> = (0..variant.parameters.len()).filter(wanted).collect();
        let mut columns = offsets();
        columns.extend(members.iter().flat_map(|used| used.columns.clone()));
        assert_eq!(used.len(), columns.len());
        let machine = Machine {
            robot: self.robot.clone(),
            values: vec![0.0; variant.parameters.len()],
            variant,
            surroundings: Surroundings::default(),
        };
        let nominal = vec![Nominal::new(0.0, None); machine.values.len()];
        let mut joint = Joint::new(machine, &nominal, &[], self.file.noise).unwrap();
        joint.used = used;
        joint.priors = vec![Nominal::new(0.0, None); columns.len()];
        let row = |sample| Row {
            sample,
            component: Component::Position,
            residual: 0,
            share: 1.0,
        };
        joint.rows = (0..ROWS).map(row).collect();
        // The priors' rows are empty.
        let of_rows = DMatrix::from_columns(&columns);
        let all = ROWS + columns.len();
        let jacobian = of_rows.clone().resize_vertically(all, 0.0);
        let solution = of_rows.svd(true, true).solve(rows, 1e-12).unwrap();
        Fit {
            joint,
            fitted: (-solution).iter().copied().collect(),
            scales: [1.0; 4],
            weights: vec![1.0; ROWS],
            factors: vec![1.0; ROWS],
            basis: Basis::of(&jacobian).unwrap(),
            jacobian: Grouped::of(&jacobian),
            residuals: remainder(rows, &columns).resize_vertically(all, 0.0),
        }
    }
}

/// Of six axes of each cart the first is along.
fn probe(index: usize) -> Probe {
    let moved = |row: usize| {
        let is_own = index == 6 * at(row).0;
        (row, if is_own { 1.0 / SIGMA_M } else { 0.0 })
    };
    Probe::new((0..ROWS).collect(), (0..ROWS).map(moved))
}

/// An effect of a model with its columns.
pub(super) struct Used {
    name: &'static str,
    place: &'static str,
    columns: Vec<DVector<f64>>,
}

pub(super) fn used(name: &'static str, place: &'static str, column: DVector<f64>) -> Used {
    Used {
        name,
        place,
        columns: vec![column],
    }
}
