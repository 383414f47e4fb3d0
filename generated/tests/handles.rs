//! Handles of the standard robot point at the rows of its tables that bear their names.

use tau_generated::gantry_tau::{GantryTau, full, full_rack, nominal, piecewise};
use tau_runtime::{DeclaredRobot, Owner, ParameterHandle, VariantHandle};

#[test]
fn variants_have_the_names_of_their_constants() {
    let named = [
        (GantryTau::NOMINAL, "Nominal"),
        (GantryTau::PIECEWISE, "Piecewise"),
        (GantryTau::FULL, "Full"),
        (GantryTau::FULL_PIECEWISE, "FullPiecewise"),
        (GantryTau::BEST_PER_LINK, "BestPerLink"),
        (GantryTau::FULL_RACK, "FullRack"),
    ];
    for (handle, name) in named {
        assert_eq!(handle.name(), name);
        assert_eq!(GantryTau::ROBOT.variants[handle.index()].name, name);
    }
    assert_eq!(named.len(), GantryTau::ROBOT.variants.len());
}

#[test]
fn parameters_have_the_names_of_their_constants() {
    let named = [
        (nominal::ARM1_LENGTH, "Nominal", "arm1.length", "m"),
        (
            piecewise::ARM3_TRACK_ROTATION_Z,
            "Piecewise",
            "arm3.track_rotation.z",
            "rad",
        ),
        (full::L2A_PLATE_JOINT_X, "Full", "l2a.plate_joint.x", "m"),
        (
            full_rack::SET2_TARGET_TWO_ROTATION_Y,
            "FullRack",
            "set2.target(two).rotation.y",
            "rad",
        ),
        (
            full_rack::RACK_PITCH_TWO_PERIOD,
            "FullRack",
            "rack_pitch(two).period",
            "m",
        ),
    ];
    for (handle, variant, name, unit) in named {
        assert_eq!(handle.variant().name(), variant);
        assert_eq!(handle.name(), name);
        assert_eq!(handle.table().unit, unit);
        let row = &GantryTau::ROBOT.variants[handle.variant().index()].parameters[handle.index()];
        assert_eq!(row.name, name);
    }
    let period = full_rack::RACK_PITCH_TWO_PERIOD.table();
    assert_eq!(period.owner, Owner::Effect(0));
    assert_eq!(period.search, Some((4e-3, 50e-3)));
}

/// A library can take the handles of any robot.
#[test]
fn handles_are_generic_over_the_robot() {
    fn path<R: DeclaredRobot>(variant: VariantHandle<R>, parameter: ParameterHandle<R>) -> String {
        assert_eq!(parameter.variant(), variant);
        format!("{parameter:?}")
    }
    assert_eq!(
        path(GantryTau::FULL_RACK, full_rack::RACK_PITCH_TWO_SINE),
        "GantryTau::FullRack::rack_pitch(two).sine"
    );
    assert_ne!(
        full::L1_LENGTH,
        full_rack::L1_LENGTH,
        "of different variants"
    );
}
