"""What the verdicts on loops assume, and what they are worth."""

BLOCKED = "every grain is held from turning, which leaves nearly every loop of any packing stable"
FREED = (
    "grains turn freely and the loop is cut out of its packing, which makes nearly every loop of "
    "five grains and more unstable; inside a packing the other grains hold it"
)
WORTH = (
    "neither says what a loop does in its packing: grainloops series compares both with the work "
    "that loops really did"
)

IN_PLACE = (
    "grains turn freely and all others stand around the loop as they do in the packing; contacts "
    "flagged sliding keep sliding, all others stick; the sample ends at: {boundary}"
)
