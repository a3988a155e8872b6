"""The results as a Markdown page, made from `results.json` and nothing else."""


def _percent(s: dict | None) -> str:
    if not s or s["trials"] == 0:
        return "–"
    low, high = s["wilson"]
    return f"{100 * s['share']:.0f} % ({100 * low:.0f}–{100 * high:.0f}; n {s['trials']})"


def _number(x: float | None) -> str:
    return "–" if x is None else f"{x:.2f}"


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = [" | ".join(head), " | ".join("---" for _ in head), *(" | ".join(r) for r in rows)]
    return "\n".join(f"| {line} |" for line in lines) + "\n"


def _overall(methods: dict) -> str:
    def row(label, pick, show=_percent):
        return [label, *[show(pick(m["summary"])) for m in methods.values()]]

    strong = lambda key: lambda s: s["single"].get("10 and more", {}).get(key)
    six = lambda s: s["single"].get("6", {}).get("first_in_class")
    rows = [
        row("False alarms, nulls", lambda s: s["false_alarm"]),
        row("Detected, z ≥ 10", strong("detected")),
        row("First name in the alias class, z ≥ 10", strong("first_in_class")),
        row("First name in the alias class, z = 6", six),
        row("True name in the set, z ≥ 10", strong("true_in_set")),
        row("The same, of those detected", strong("set_right")),
        row("Mean size of the set, z ≥ 10", strong("mean_set_size"), _number),
        row("Both of two, each z ≥ 10", lambda s: s["double"]["10 and more"]),
        row("Both of two, all z", lambda s: s["double"]["all"]),
        row("Outside the catalogue: unexplained", lambda s: s["outside"]["unexplained"]),
        row("Outside the catalogue: misnamed", lambda s: s["outside"]["misnamed"]),
        row("Absorbed by the plan: abstained", lambda s: s["aliased"]["abstained"]),
        row("Aliased: first name in the class", lambda s: s["aliased"]["first_in_class"]),
        row("Aliased: answered by a set", lambda s: s["aliased"]["answered_by_a_set"]),
        row("Channel located, z ≥ 10", strong("channel")),
        row("Span overlap (IoU) ≥ 0.7, z ≥ 10", strong("span_overlap")),
        row("Parameter inside its 95 % interval, z ≥ 10", strong("covered")),
        row(
            "Parameter inside its 95 % interval, all single effects and pairs",
            lambda s: s["covered"],
        ),
        row("Held-out rms / oracle's rms, median", strong("held_out_ratio"), _number),
        row("Held-out improvement / oracle's, median", strong("improvement_ratio"), _number),
        row("Runs that failed", lambda s: s["failed"], str),
        row("Seconds a case, median", lambda s: s["seconds"]["median"], _number),
    ]
    return _table(["Figure", *methods], [r for r in rows if set(r[1:]) != {"–"}])


def _by_size(summary: dict) -> str:
    keys = ("detected", "first_in_class", "true_in_set", "channel", "span_overlap", "covered")
    rows = []
    for z, group in summary["single"].items():
        rows.append([z, *[_percent(group[k]) for k in keys], _number(group["mean_set_size"])])
    head = ["z", "detected", "first name in class", "true name in set", "channel", "IoU ≥ 0.7"]
    return _table([*head, "interval covers", "set size"], rows)


def _confusion(table: dict) -> str:
    said = sorted({name for row in table.values() for name in row})
    rows = [[true, *[str(row.get(s, "")) for s in said]] for true, row in table.items()]
    return _table(["true \\ said", *said], rows)


def _given(name: str, given: dict) -> str:
    return (
        f"Held-out residual of {name} over that of a fit which is given the name and the channels, on the same "
        f"rows, {given['cases']} single effects of z ≥ 10 (without those where the diagnosis reports the other "
        f"triad's residual, or the catalogue has no form for the plan): median {given['median']:.3f}, at most 1.08 in "
        f"{given['within 1.08']}, largest {given['largest']:.2f}.\n"
    )


def _informed(methods: dict) -> str:
    """The cases whose type of device has siblings, with and without what these tell of the noise."""
    rows = []
    summaries = [m["summary"] for m in methods.values()]
    if summaries[0]["false_alarm"]["trials"]:
        rows.append(["False alarms, nulls", *[_percent(s["false_alarm"]) for s in summaries]])
    told = (
        ("detected", "detected"),
        ("first name in class", "first_in_class"),
        ("true name in set", "true_in_set"),
    )
    for z in summaries[0]["single"]:
        for label, key in told:
            cells = [_percent(s["single"][z][key]) for s in summaries]
            rows.append([f"z = {z}: {label}", *cells])
        rows.append(
            [f"z = {z}: set size", *[_number(s["single"][z]["mean_set_size"]) for s in summaries]]
        )
    return _table(["Figure", *methods], rows)


def markdown(results: dict, title: str = "Blind proof") -> str:
    """The whole page."""
    methods = results["methods"]
    first = next(iter(methods))
    count = sum(methods[first]["summary"]["cases"].values())
    drawn = results.get("drawn", count)
    of_all = f" of {drawn} drawn" if drawn > count else ""
    parts = [
        f"# {title}\n",
        f"{count} concealed cases{of_all}, seed {results['seed']}; SHA-256 of the answers, printed before any "
        f"run: `{results['sealed']}`. Shares with 95 % Wilson intervals and numbers of cases.\n",
        "## All methods\n",
        _overall(methods),
    ]
    if "given" in results:
        parts.append(_given(first, results["given"]))
    if "informed" in results:
        parts += [
            "## With the noise of the type known\n",
            "Cases whose type has four other units, alone and with what these tell of the noise "
            "(`inertiax learn-noise`).\n",
            _informed(results["informed"]),
        ]
    for name, method in methods.items():
        parts += [f"## {name}: single effects by size\n", _by_size(method["summary"])]
        parts += [f"## {name}: first name said, z ≥ 6\n", _confusion(method["confusion"])]
    return "\n".join(parts)
