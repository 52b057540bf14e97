"""Plans: what they say, and that one which nobody should trust is refused in a sentence."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from degense.app.batch.folder import BatchFolder, JobRecord
from degense.app.batch.plan import BatchJob, JobOptions, check_name, name_of, with_own_names
from degense.app.batch.plan_file import MOST_BYTES, found, jobs_of, read_plan
from degense.app.batch.report import write_report
from degense.engine.errors import DegenseError


@pytest.fixture
def plan(tmp_path):
    """Read a plan of this text, beside the clips `a`, `b` and `c.mp4`."""
    for name in ("a", "b"):
        (tmp_path / "clips" / name).mkdir(parents=True)
    (tmp_path / "clips" / "c.mp4").touch()

    def plan(text: str) -> list[BatchJob]:
        (tmp_path / "plan.toml").write_text(text, encoding="utf-8")
        return read_plan(tmp_path / "plan.toml")

    return plan


def test_every_clip_with_every_variant(plan, tmp_path):
    jobs = plan(
        """
        clips = ["clips/*"]
        preset = "quick"
        prompts = ["liver"]
        settings = { flow = 3, levels = [1, 2] }
        [[clip]]
        path = "other.mp4"
        name = "case-7"
        prompts = []
        settings = { flow = 5.0 }
        [variant.paper]
        routing = "paper"
        [variant.ours]
        """
    )
    assert [job.name for job in jobs] == [f"{clip}-{kind}" for clip in ("a", "b", "c", "case-7") for kind in ("paper", "ours")]
    assert [job.training.clip for job in jobs[::2]] == [tmp_path / name for name in ("clips/a", "clips/b", "clips/c.mp4", "other.mp4")]
    assert {job.training.preset for job in jobs} == {"quick"}
    assert [job.training.routing for job in jobs[:2]] == ["paper", None]
    assert [job.prompts for job in jobs[::2]] == [("liver",)] * 3 + [()]
    assert jobs[0].training.config().flow == 3
    assert (jobs[-1].training.config().flow, jobs[-1].training.config().levels) == (5, (1, 2))
    assert "query" not in jobs[-1].stages()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("clips = [", "is not TOML"),
        ("clip = 1", r"written \[\[clip\]\]"),
        ('clips = "clips/a"', "list of texts"),
        ("", "0 jobs"),
        ('clips = ["clips/x*"]', "finds no clips"),
        ('clips = ["**/*"]', "within one folder"),
        ('clips = ["clips/a"]\npresett = "quick"', "no setting 'presett'; did you mean 'preset'"),
        ('clips = ["clips/a"]\nout = "elsewhere"', "no setting 'out'"),
        ('clips = ["clips/a"]\npreset = "slow"', "no preset 'slow'"),
        ('clips = ["clips/a"]\niterations = "many"', "iterations is a whole number, not 'many'"),
        ('clips = ["clips/a"]\niterations = -3', "iterations is a whole number"),
        ('clips = ["clips/a"]\niterations = true', "iterations is a whole number"),
        ('clips = ["clips/a"]\nstride = 0', "stride"),
        ('clips = ["clips/a"]\nfocal = nan', "focal length"),
        ('clips = ["clips/a"]\nprompts = "liver"', "list of texts"),
        ('clips = ["clips/a"]\nprompts = ["liver", "Liver"]', "a prompt twice"),
        ('clips = ["clips/a"]\nprompts = ["a\\u0007b"]', "control characters"),
        ('clips = ["clips/a"]\nexports = ["exe"]', "no format 'exe'"),
        ('[[clip]]\npath = "a\\u0000b"', "control characters"),
        ('clips = ["clips/a"]\nlabels = "a\\u0000b"', "control characters"),
        ('clips = ["clips/a\\u0000*"]', "cannot be looked for|finds no clips"),
        ('clips = ["clips/a"]\nsettings = { flwo = 3 }', "no setting 'flwo'; did you mean 'flow'"),
        ('clips = ["clips/a"]\nsettings = { flow = 1979-05-27 }', "a setting is a number"),
        ('clips = ["clips/a"]\nsettings = 3', "settings is a table"),
        ('[[clip]]\nname = "x"', "needs path"),
        ('[[clip]]\npath = "a"\nname = "../../x"', "cannot name a job"),
        ('[[clip]]\npath = "a"\nname = "NUL.txt"', "Windows reserves"),
        ('clips = ["clips/a"]\n[variant."../up"]\npreset = "quick"', "cannot name a job"),
        ('clips = ["clips/a"]\n[variant.x]\nclips = ["b"]', "no setting 'clips'"),
        ("x = " + "[" * 20_000, "is not TOML"),
    ],
)
def test_what_is_no_plan_is_refused_in_a_sentence(plan, text, words):
    with pytest.raises(DegenseError, match=words) as caught:
        plan(text)
    assert "\n" not in str(caught.value)


def test_large_files_are_not_read(plan, tmp_path):
    with pytest.raises(DegenseError, match="larger than"):
        plan("# " + "x" * MOST_BYTES)
    with pytest.raises(DegenseError, match="cannot be read"):
        read_plan(tmp_path / "absent.toml")
    many = "\n".join(f"[variant.v{number}]" for number in range(2000))
    with pytest.raises(DegenseError, match="more than 100,000 jobs"):
        plan('clips = ["clips/*"]\n' + "".join(f'[[clip]]\npath = "{number}"\n' for number in range(60)) + many)


@pytest.mark.parametrize(
    ("key", "value"),
    [("prompts", True), ("prompts", [1]), ("decoder", 3), ("threshold", "0.5"), ("scores", "yes"), ("name", None)],
)
def test_a_kept_job_with_values_of_another_kind_is_refused(plan, key, value):
    [job, *_] = plan('clips = ["clips/a"]')
    with pytest.raises(DegenseError, match="A job of the batch cannot be read"):
        BatchJob.from_json(job.to_json() | {key: value})


def test_a_record_of_a_job_that_is_damaged_counts_as_none(plan, tmp_path):
    folder = BatchFolder(tmp_path / "out")
    [job, *_] = folder.begin(plan('clips = ["clips/a"]'))
    folder.keep(job, JobRecord({"train": {}}, {"train": 1.5}))
    path = folder.path / "jobs" / f"{job.name}.json"
    sound = json.loads(path.read_text())
    for change in (
        {"seconds": {"train": "long"}},
        {"seconds": [1]},
        {"done": 3},
        {"done": {"train": "x"}},
        {"seconds": {"train": float("inf")}},
    ):
        path.write_text(json.dumps(sound | change))
        assert folder.record(job) == JobRecord({}, {})
        assert write_report(folder, [job])


#: What TOML can say, and names that mean something.
VALUES = st.recursive(
    st.one_of(st.booleans(), st.integers(), st.floats(), st.text(max_size=8), st.dates()),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)
KEYS = st.sampled_from(["clips", "clip", "variant", "preset", "prompts", "settings", "exports", "threshold", "start", "path", "name"])


@given(st.dictionaries(KEYS | st.text(max_size=6), VALUES, max_size=4))
def test_any_table_is_a_plan_or_refused(tmp_path_factory, table):
    base = tmp_path_factory.getbasetemp()
    try:
        jobs = jobs_of(table, base, "plan")
    except DegenseError:
        jobs = []
    folder = BatchFolder(base / "out")
    assert all(folder.run(job).parent == folder.path / "runs" for job in jobs)


@given(st.text(max_size=200))
def test_a_clip_of_any_name_gets_a_folder_name(text):
    check_name(name_of(Path(text)))


def test_names_are_unique_in_any_case(tmp_path):
    job = JobOptions().job(tmp_path / "A", "A", tmp_path)
    lower = JobOptions().job(tmp_path / "a", "a", tmp_path)
    names = [found.name.casefold() for found in with_own_names([job, lower, job, lower])]
    assert len(set(names)) == 4


def test_jobs_are_kept_as_json(tmp_path):
    options = JobOptions(preset="quick", prompts=("liver",), exports=("ply",), threshold=0.5, settings=(("flow", "3"),), teacher="labels")
    job = options.job(tmp_path / "a", "a", tmp_path)
    again = BatchJob.from_json(json.loads(json.dumps(job.to_json())))
    assert again.stages() == job.stages()
    for wrong in (
        {},
        [],
        {"name": "a"},
        job.to_json() | {"name": "../a"},
        job.to_json() | {"prompts": 3},
        job.to_json() | {"exports": ["x"]},
    ):
        with pytest.raises(DegenseError):
            BatchJob.from_json(wrong)


def test_a_teachers_folder_is_named_in_full(tmp_path):
    (tmp_path / "features").mkdir()
    jobs = [
        JobOptions(teacher=name).job(tmp_path / "a", "a", tmp_path) for name in ("precomputed:features?level=1", "vlm:some/model", "labels")
    ]
    assert [job.training.teacher for job in jobs] == [f"precomputed:{tmp_path / 'features'}?level=1", "vlm:some/model", "labels"]


def test_patterns_find_what_is_visible(tmp_path):
    for name in ("b", "a", ".hidden"):
        (tmp_path / name).mkdir()
    assert [path.name for path in found("*", tmp_path)] == ["a", "b"]
    assert [path.name for path in found(str(tmp_path / "?"), tmp_path / "elsewhere")] == ["a", "b"]


def test_a_path_that_is_there_is_taken_as_it_is(tmp_path):
    """Brackets stand for themselves; so do * and ? in the name of a folder that is there."""
    for name in ("case [1] $x & 'y'/clip", "case 1/clip", "what?", "whatever"):
        (tmp_path / name).mkdir(parents=True)
    for base, start in ((tmp_path, ""), (tmp_path / "elsewhere", f"{tmp_path}/")):
        assert found(f"{start}case [1] $x & 'y'", base) == [Path(f"{start}case [1] $x & 'y'")]
        assert [path.relative_to(tmp_path).as_posix() for path in found(f"{start}case [1]*/c*", base)] == ["case [1] $x & 'y'/clip"]
        assert found(f"{start}what?", base) == [Path(f"{start}what?")]
    assert found("case [2]", tmp_path) == [Path("case [2]")]  # which then is said not to exist
