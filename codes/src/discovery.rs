//! Effects that a model lacks.

codes! {
    LACKS = 601: "the measurements lack what an effect reads";

    // What a search refuses, and remarks on what it did.
    NO_BASE = 630: "no variant has all links and no effects";
    RESERVED_NAME = 631: "a variant or an effect has a name that the search gives";
    NOT_SOUND = 632: "a description that the search wrote has mistakes";
    EFFECT_TWICE = 633: "an effect is not used because another has its name";
    FAR_HELD_OUT = 634: "held-out poses are far off and not counted";
    SET_LEFT_OUT = 635: "a set takes no part in the search";
    DRIVES_CONTRADICT = 636: "drives contradict each other by more than their noise";
    OTHER_NOISE = 637: "noise differs from the stated one";
    FAR_FROM_DRAWING = 638: "dimensions are far from the robot file";
    SERIAL = 639: "neighbours in the order of measurement have similar residuals";
    PART = 640: "a part of the poses took part in the search";
    REDUCED_ARM = 641: "effects of links took no part because the arm is reduced";
    ROWS_LEFT_OUT = 642: "rows were left out";
    NO_CALIBRATION = 643: "the result could not be calibrated";
    NOT_SEARCHED = 644: "nothing was searched for";
    OTHER_TREATMENT = 645: "the search leaves outliers out whatever was asked for";
    UNCONFIRMED = 646: "held-out measurements do not confirm what was found";
    OPPOSED = 647: "neighbours in the order of measurement have opposed residuals";
}
