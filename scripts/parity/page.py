"""The page of kept parity figures."""

from markdown import rows

TEXT = """# Parity with Cycles

{within} of {all} light sets are within limits. Made from `parity.json` by `make parity`;
`PARITY="--features --version 5.3"` runs the scenes of one feature in another Blender.

A picture by Relume and one by Cycles are compared by means of blocks of 8 x 8 pixels. Figures are the worst of a
scene's light sets, each of six random lights, one of a kind. A set is within limits if one of these holds:

- the median difference is at most {median:.0%} and the 95th percentile at most {p95:.0%};
- at most {beyond:.0%} of the blocks differ by more than three standard errors and 0.5 %.

{table}
"""
FIGURES = ("median", "p95", "mean ratio", "noise of Cycles, p95", "beyond noise")
HEAD = ["scene", "Blender", "date", "sets", *FIGURES, "verdict"]


def text(records, median, p95, beyond):
    """The page, a row for each scene and Blender version."""
    groups = {}
    for record in records:
        groups.setdefault((record["scene"], record["version"]), []).append(record)
    within = sum(record["within_limits"] for record in records)
    table = rows(HEAD, [row(*key, sets) for key, sets in groups.items()])
    return TEXT.format(within=within, all=len(records), median=median, p95=p95, beyond=beyond, table=table)


def row(scene, version, sets):
    """A row of the table."""
    worst = {name: max(one[name] for one in sets) for name in ("median", "p95", "noise_p95", "beyond_noise")}
    ratio = max((one["mean_ratio"] for one in sets), key=lambda value: abs(value - 1.0))
    within = sum(one["within_limits"] for one in sets)
    verdict = "equal" if within == len(sets) else f"**{len(sets) - within} differ**"
    shares = [f"{worst[name]:.2%}" for name in ("median", "p95")]
    rest = [f"{worst[name]:.2%}" for name in ("noise_p95", "beyond_noise")]
    return [scene, version, max(one["date"] for one in sets), str(len(sets)), *shares, f"{ratio:.4f}", *rest, verdict]
