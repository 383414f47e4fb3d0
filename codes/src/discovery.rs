//! Effects that a model lacks.

codes! {
    LACKS_COLUMN = 601: "a column that an effect reads is missing";
    LACKS_VALUE = 602: "a value that an effect reads is missing in the robot file or the description";
    LACKS_FILE = 603: "a file that shows an effect is missing";
    LACKS_TRACKER = 604: "no tracker measured what an effect acts on";
    LACKS_PART = 605: "the machine has no part that an effect acts on";
    NEEDS_FULL_ARM = 606: "an effect needs a full arm";
    NOT_FINITE = 607: "the derivative by an effect is not finite";
    CONSTANT = 608: "a quantity that an effect reads never changes";
    ABSORBED = 609: "the base absorbs an effect";
    MOSTLY_ABSORBED = 610: "the base absorbs most of an effect";
    IMPLAUSIBLE = 611: "an effect would be seen only from an implausible amplitude on";
    SEPARABLE = 612: "further poses tell an effect from its rival";
    NOT_IN_SET_1 = 613: "no measurement of set 1 tells an effect from its rival";
    INSEPARABLE = 614: "a rival explains whatever the effect does";
    TOO_FEW_POSES = 615: "further poses do not tell an effect from its rival well enough";
    FOUND = 616: "a candidate is in the model";
    RIVAL = 617: "a candidate could be meant instead of an effect in the model";
    NOT_SIGNIFICANT = 618: "a candidate is not significant";
    NOT_CONFIRMED = 619: "a candidate does not predict blocks that were held out";
    NOT_THE_BEST = 620: "structure without a name explains the residuals better than a candidate";
    EXPLAINED_BY_OTHERS = 621: "nothing of a candidate is left beside what was found";
    WITHOUT_NAME = 622: "a candidate is in the model but names no cause";
    EXPLAINED = 623: "missing effects have names, and nothing significant is left";
    NOTHING_MISSING = 624: "the base explains the measurements";
    UNNAMED_STRUCTURE = 625: "something is missing that no effect explains";
    PARTLY_EXPLAINED = 626: "something that is missing has a name, something has none";
    NOISY = 629: "no effect is significant, yet the noise is far larger than stated";
    FAR_FROM_DRAWING = 638: "dimensions are far from the robot file";
    UNCONFIRMED = 646: "held-out measurements do not confirm what was found";
    ALIASES = 660: "another value of a searched parameter fits as well";
    AMBIGUOUS = 661: "effects can hardly be told apart by these measurements";
    NO_AMPLITUDE = 662: "an effect has no amplitude to fit";
}
