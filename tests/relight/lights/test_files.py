import json
import os

import numpy as np
import pytest
import yaml

import relight

LIGHTS = [
    relight.DirectionalLight(azimuth=-40, elevation=30, intensity=2, colour=(1, 0.9, 0.8), name="key"),
    relight.DirectionalLight(azimuth=140, temperature=9000, locus="daylight", angle=20, exposure=-0.5),
    relight.DirectionalLight(name="naïve light: 3"),
]


@pytest.mark.parametrize("name", ["lights.yaml", "lights.yml", "lights.json", "LIGHTS.YAML"])
def test_lights_are_read_back_equal_from_yaml_and_json(tmp_path, name):
    relight.write_lights(tmp_path / name, LIGHTS)
    assert relight.read_lights(tmp_path / name) == LIGHTS
    assert os.listdir(tmp_path) == [name]


@pytest.mark.parametrize("name", ["lights.yaml", "lights.json"])
@pytest.mark.states("Lights files", "a byte order mark of UTF-8", "honoured")
def test_a_byte_order_mark_is_passed_over(tmp_path, name):
    relight.write_lights(tmp_path / name, LIGHTS)
    (tmp_path / name).write_bytes(b"\xef\xbb\xbf" + (tmp_path / name).read_bytes())
    assert relight.read_lights(tmp_path / name) == LIGHTS


@pytest.mark.parametrize("name", ["lights.yaml", "lights.json"])
@pytest.mark.parametrize("encoding", ["utf-16", "latin-1"])
@pytest.mark.states("Lights files", "another encoding than UTF-8", "refused")
def test_another_encoding_is_refused(tmp_path, name, encoding):
    text = json.dumps({"lights": [{"name": "clé", "azimuth": 3}]}, ensure_ascii=False)
    (tmp_path / name).write_text(text, encoding=encoding)
    with pytest.raises(ValueError, match=rf"{name}: is not a lights file: it is no UTF-8; save it as UTF-8"):
        relight.read_lights(tmp_path / name)


def test_any_direction_comes_back(tmp_path):
    light = relight.DirectionalLight((0.3, -0.2, 0.1))
    relight.write_lights(tmp_path / "l.yaml", [light])
    (back,) = relight.read_lights(tmp_path / "l.yaml")
    assert back.direction == pytest.approx(light.direction, abs=2e-6)


def test_a_file_says_only_what_is_not_the_default(tmp_path):
    relight.write_lights(tmp_path / "l.yaml", LIGHTS[:1])
    assert (tmp_path / "l.yaml").read_text() == (
        "lights:\n- name: key\n  azimuth: -40\n  elevation: 30\n  intensity: 2\n  colour: [1, 0.9, 0.8]\n"
    )


def test_yaml_as_people_write_it(tmp_path):
    (tmp_path / "l.yaml").write_text(
        "lights:\n"
        "  - &key {type: directional, direction: [0, 1, 1], intensity: 1e1}\n"
        "  - {<<: *key, intensity: 2.5e-1, name: dim}\n"
    )
    bright, dim = relight.read_lights(tmp_path / "l.yaml")
    assert (bright.intensity, dim.intensity, dim.name) == (10, 0.25, "dim")
    assert dim.direction == bright.direction


def test_numbers_and_words_are_those_of_yaml_12(tmp_path):
    texts = ["010", "0o10", "0x10", "+1e3", ".5", "1.e1", "0.0"]
    lines = [f"- {{name: {name}, intensity: {text}}}" for name, text in zip("abcdefg", texts, strict=True)]
    (tmp_path / "l.yaml").write_text("lights:\n" + "\n".join(lines) + "\n- {name: on, colour: [1, 08, 9]}")
    *lights, last = relight.read_lights(tmp_path / "l.yaml")
    assert [light.intensity for light in lights] == [10, 8, 16, 1000, 0.5, 10, 0]
    assert (last.name, last.colour) == ("on", (1, 8, 9))
    names = ["on", "null", "1e3", "010", "0o7", "~", "1:30", "2026-01-01", "=", "true", "yes"]
    lights = [relight.DirectionalLight(name=name) for name in names]
    relight.write_lights(tmp_path / "l.yaml", lights)  # of names that look like something else
    assert relight.read_lights(tmp_path / "l.yaml") == lights


def test_merges_of_merges_are_bounded(tmp_path):
    lines = ["a0: &a0 {azimuth: 1}"]
    lines += [f"a{n}: &a{n} {{<<: [{', '.join([f'*a{n - 1}'] * 10)}]}}" for n in range(1, 9)]
    (tmp_path / "l.yaml").write_text("\n".join([*lines, "lights: [*a8]"]))
    # PyYAML 6.0.4 merges a repeated mapping once, so that what it refuses is the key a0.
    refusal = r"l\.yaml: (is not a lights file: merges too many keys|a0: not known here)"
    with pytest.raises(ValueError, match=refusal):
        relight.read_lights(tmp_path / "l.yaml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected 'lights:' and a list of lights, got None"),
        ("- {azimuth: 3}", "expected 'lights:' and a list of lights"),
        ("lights: {azimuth: 3}", "lights: expected a list, got {'azimuth': 3}"),
        ("lights: []\nfps: 3", "fps: not known; expected lights"),
        ("lights: [3]", "light 1: expected parameters and their values, got 3"),
        (
            "lights: [{}, {name: rim, azimut: 3}]",
            r"light 2 \(rim\): azimut: not known; did you mean azimuth",
        ),
        ("lights: [{azimuth: left}]", "light 1: azimuth: expected a number.*, got 'left'"),
        ("lights: [{azimuth: [1, 2]}]", r"light 1: azimuth: expected a number.*, got \[1, 2\]"),
        ("lights: [{intensity: -1}]", "light 1: intensity: expected a number of at least 0, got -1"),
        ("lights: [{intensity: .nan}]", "light 1: intensity: expected a finite number"),
        ("lights: [{intensity: true}]", "light 1: intensity: expected a number.*, got True"),
        ("lights: [{intensity: yes}]", "light 1: intensity: expected a number.*, got 'yes'"),
        ("lights: [{intensity: 1:30}]", "light 1: intensity: expected a number.*, got '1:30'"),
        ("lights: [{intensity: 1_000}]", "light 1: intensity: expected a number.*, got '1_000'"),
        ("lights: [{[1, 2]: 3}]", "is not a lights file: a key is no text in .*line 1, column 11"),
        ("lights: !!bool perhaps", "is not a lights file: 'perhaps'"),
        ("lights: !!timestamp today", "is not a lights file"),
        ("lights: !!int [1]", "is not a lights file: expected a scalar node"),
        ("lights: [!!int {a: 1}]", "is not a lights file: expected a scalar node"),
        ("? {a: 1}\n: 2", "is not a lights file: a key is no text"),
        ("lights: [{name: !!binary aGk=}]", "light 1: name: expected a text"),
        ("lights: [{colour: 1}]", "light 1: colour: expected 3 numbers of at least 0, got 1"),
        ("lights: [{name: true}]", "light 1: name: expected a text, got True"),
        ("lights: [{type: spot}]", "light 1: type: expected directional.*, got 'spot'"),
        ("lights: [{type: [spot]}]", "light 1: type: expected directional"),
        ("lights: [{azimuth: 1, azimuth: 2}]", "is not a lights file: 'azimuth' is there twice"),
        ("lights: [{azimuth: 1", "is not a lights file: while parsing"),
        ("lights: !!python/object:os.system {}", "is not a lights file: could not determine a constructor"),
        ("[" * 1100, "is not a lights file"),
        ("lights: [{intensity: !!float ''}]", "is not a lights file"),
        (f"lights: [{{orbit: {10**400}}}]", "light 1: orbit: expected"),
        (f"lights: [{{azimuth: {{1: {10**400}}}}}]", "light 1: azimuth: expected numbers at frame 1"),
        (f"lights: [{{azimuth: {{{10**400}: 1}}}}]", "light 1: azimuth: expected the number of a frame"),
        ("lights: [{locus: [a]}]", r"light 1: locus: expected one of planckian, daylight, got \['a'\]"),
    ],
)
def test_mistakes_are_named(tmp_path, text, message):
    path = tmp_path / "l.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match=rf"l\.yaml: {message}"):
        relight.read_lights(path)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"name": "a\nb", "azimut": 3}, r"light 1 \('a\\nb'\): azimut: not known"),
        ({"name": "x" * 5000, "azimut": 3}, r"light 1 \('xxx.*\.\.\..*xxx'\): azimut: not known"),
        ({"a\nb": 3}, r"light 1: 'a\\nb': not known"),
        ({"x" * 5000: 3}, r"light 1: 'xxx.*\.\.\..*xxx': not known"),
        ({"image": "a\nb.exr", "type": "environment"}, "light 1: .*a b.exr: no such file"),
    ],
)
def test_mistakes_are_named_in_one_short_line(tmp_path, entry, message):
    path = tmp_path / "l.json"
    path.write_text(json.dumps({"lights": [entry]}))
    with pytest.raises(ValueError, match=message) as caught:
        relight.read_lights(path)
    assert len(str(caught.value).splitlines()) == 1
    assert len(str(caught.value)) < 500


def test_mistakes_in_json_are_named(tmp_path):
    path = tmp_path / "l.json"
    for text, message in [
        ('{"lights": [{"azimuth": 1, "azimuth": 2}]}', "'azimuth' is there twice"),
        ('{"lights": [', "is not a lights file: Expecting value"),
        ('{"lights": [{"intensity": NaN}]}', "light 1: intensity: expected a finite number"),
    ]:
        path.write_text(text)
        with pytest.raises(ValueError, match=rf"l\.json: .*{message}|l\.json: {message}"):
            relight.read_lights(path)


def test_what_is_no_lights_file_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"gone\.yaml: no such file"):
        relight.read_lights(tmp_path / "gone.yaml")
    with pytest.raises(ValueError, match=r"l\.txt: expected a lights file, whose name ends in \.yaml"):
        relight.read_lights(tmp_path / "l.txt")
    (tmp_path / "l.yaml").write_bytes(b"\xff\xfe\x00lights")
    with pytest.raises(ValueError, match=r"l\.yaml: is not a lights file"):
        relight.read_lights(tmp_path / "l.yaml")


def test_an_environment_is_looked_for_beside_the_lights_file(tmp_path, here):
    (tmp_path / "show").mkdir()
    relight.write(tmp_path / "show" / "sky.exr", np.ones((4, 8, 3), np.float32))
    (tmp_path / "show" / "l.yaml").write_text(
        "lights: [{type: environment, image: sky.exr, rotation: 90, name: sky}]"
    )
    (light,) = relight.read_lights(tmp_path / "show" / "l.yaml")
    assert light == relight.EnvironmentLight(tmp_path / "show" / "sky.exr", rotation=90, name="sky")
    relight.write_lights("rig.json", [relight.EnvironmentLight("show/sky.exr", rotation=90)])
    assert json.loads((tmp_path / "rig.json").read_text()) == {
        "lights": [{"type": "environment", "image": "show/sky.exr", "rotation": 90}]
    }
    assert relight.read_lights("rig.json")[0].rotation == 90
    relight.write_lights("rig.json", [light])  # from an absolute path, which stays one
    assert relight.read_lights("rig.json") == [light]
    with pytest.raises(ValueError, match="image: the environment is an array; write it to a file"):
        relight.write_lights("rig.json", [relight.EnvironmentLight(np.ones((4, 8, 3)))])
    for text, message in [
        ("{type: environment}", "light 1: image: is missing"),
        ("{type: environment, image: 3}", "light 1: image: expected a file, got 3"),
        ("{type: environment, image: gone.exr}", "light 1: .*gone.exr: no such file"),
        (
            "{type: environment, image: show/sky.exr, azimuth: 3}",
            "light 1: azimuth: not known; expected image",
        ),
    ]:
        (tmp_path / "l.yaml").write_text(f"lights: [{text}]")
        with pytest.raises(ValueError, match=rf"l\.yaml: {message}"):
            relight.read_lights(tmp_path / "l.yaml")


def test_a_failing_write_keeps_the_old_file(tmp_path, full_disk):
    path = tmp_path / "l.json"
    relight.write_lights(path, LIGHTS[:1])

    with full_disk(), pytest.raises(OSError, match="No space left"):
        relight.write_lights(path, LIGHTS)
    assert os.listdir(tmp_path) == ["l.json"]
    assert relight.read_lights(path) == LIGHTS[:1]
    with pytest.raises(TypeError, match=r"lights: expected lights, e\.g\. DirectionalLight, got str"):
        relight.write_lights(path, ["key"])


def test_other_programs_read_what_is_written(tmp_path):
    relight.write_lights(tmp_path / "l.yaml", LIGHTS)
    relight.write_lights(tmp_path / "l.json", LIGHTS)
    in_yaml = yaml.safe_load((tmp_path / "l.yaml").read_text(encoding="utf-8"))
    assert in_yaml == json.loads((tmp_path / "l.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("text", ['{"lights": [], "a\\nb": 1}', '{"a\\nb": 1, "a\\nb": 2}'])
def test_so_are_those_of_its_own_keys(tmp_path, text):
    path = tmp_path / "l.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"l\.json: .*a\\nb") as caught:
        relight.read_lights(path)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.states("Lights files", "more than 1,000 lights", "refused")
@pytest.mark.parametrize("suffix", [".yaml", ".json"])
def test_more_lights_than_memory_has_layers_for_are_refused(tmp_path, suffix):
    path = tmp_path / f"many{suffix}"
    relight.write_lights(path, [relight.DirectionalLight(name=f"l{n}") for n in range(1001)])
    with pytest.raises(ValueError, match=r"many\.\w+: holds 1001 lights; expected at most 1000"):
        relight.read_lights(path)
