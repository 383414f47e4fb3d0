//! Fits, and the verdicts on them.

codes! {
    NOT_CONVERGED = 301: "a fit did not converge";

    // What a fit refuses, and remarks on what it was made of.
    TOO_FEW_POSES = 330: "too few poses calibrate";
    NO_POSES = 331: "there are no measured poses, or no pose of this number";
    NONE_IN_RANGE = 332: "no pose has all its commands in the measured range";
    EMPTY_SPLIT = 333: "a split leaves no poses to calibrate or none to validate";
    NOTHING_HELD_OUT = 334: "no measurement is left to judge by";
    SAME_POSES = 335: "all calibration poses are the same";
    NO_VALUE = 336: "nothing gives a value for a parameter";
    NO_PATH = 337: "a variant needs the path of a cart that was not measured";
    OTHER_CALIBRATION = 338: "a calibration is of another robot, variant or other poses";
    FITS_ANYTHING = 339: "there are too few residuals to judge a fit";
    NOTHING_SEEN = 340: "the measurements do not depend on the parameters";
    RANK = 341: "the measurements determine too few unknowns";
    NO_SCALE = 342: "nothing determines the scale";
    NO_SINGLE_READING = 343: "no single reading can be recognised as an outlier";
    LENGTH_UNIT = 344: "lengths seem to be in another unit, or of another kind";
    COMMAND_UNIT = 345: "commands seem to be degrees";
    CONTRADICTION = 346: "exact drives have two commands at one pose";
    NOISE_UNSTATED = 347: "nothing states the noise of a measurement";
    NOISE_TWICE = 348: "the noise of a measurement is stated twice";
    NOISE_NEEDED = 349: "noise is to be estimated where its value is needed";
    NO_TRACKER = 350: "a variant has an error of the tracker where no tracker measured";
    NO_DEPENDENCE = 351: "closures do not depend on the pose or the drives";
    NEEDS_MEASURED_POSES = 352: "only fits of measured poses can do this";
    NOT_CALIBRATED = 353: "no closure of the variant depends on a parameter";
    START_VALUES = 354: "the start values of a fit do not suit its variant";
    BAD_OBSERVATION = 355: "a pose in memory has the wrong number of commands, or a number that is not finite";
    POSES_DROPPED = 356: "poses outside the measured range take no part";
    PLATE_ALONE = 357: "files of carts took no part in a fit";
    NOISE_TAKEN_FOR_ZERO = 358: "the noise of a measured quantity is taken for zero";
    VARIANT_LEFT_OUT = 359: "variants or tables of the study are left out";
    REFUSED = 360: "a result is refused because it means nothing";
    SENSITIVITIES_DIFFER = 361: "sensitivities by derivatives and by steps differ";
}
