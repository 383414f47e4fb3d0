//! A user's crate: it depends on `tau` alone, declares its robot with a variant and an
//! effect of its own, calibrates it on a measurement folder, and reads the result.

mod session;

use tau::{Error, Session, tau_model};

const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../data/prototype");

tau_model! {
    /// A Gantry-Tau with a pinion that runs out of true on its second track.
    pub robot Gantry {
        track one, two, three;
        cluster arm1 on one   { link l1; }
        cluster arm2 on two   { link l2a, l2b; }
        cluster arm3 on three { link l3a, l3b, l3c; }

        /// Every link with its own joints; the links of a cart share its straight path.
        variant Shared { arm full; tracks linear; }

        /// The cart gets ahead of its command and falls behind once a turn of the pinion.
        effect runout on cart {
            param sine, cosine: length tol 100 um;
            search period: length in 350 mm ..= 500 mm;
            along += sine * sin(2*pi*q/period) + cosine * cos(2*pi*q/period);
        }
        variant Runout = Shared + runout(two);
    }
}

#[test]
fn an_effect_of_ones_own_is_found_and_closes_the_gap() -> Result<(), Error> {
    let session = Session::<Gantry>::open(FOLDER)?;
    let shared = session.calibrate(Gantry::SHARED)?;
    let runout = session.calibrate(Gantry::RUNOUT)?;
    let without_um = session.evaluate(&shared.machine)?.position_um.mean;
    let with_um = session.evaluate(&runout.machine)?.position_um.mean;

    let period = runout.estimate(gantry::runout::RUNOUT_TWO_PERIOD)?;
    let sine = runout.estimate(gantry::runout::RUNOUT_TWO_SINE)?;
    println!(
        "position error {without_um:.0} µm without the effect, {with_um:.0} µm with a pinion of \
         {:.1} ± {:.1} mm",
        period.value * 1e3,
        period.sigma * 1e3
    );
    assert!(sine.value.abs() > 10.0 * sine.sigma);
    assert_eq!(period.unit, "m");
    assert!(period.sigma < 5e-3);
    assert!(with_um < 0.9 * without_um);
    Ok(())
}
