"""What headings mean: the quantity, its unit, and words that make it another one."""

import pytest

from taichi_erosion.tables.headings import (
    meaning_of,
    meaning_of_only_angle,
    meaning_of_symbol,
    qualifying_words,
    read_heading,
    suggest_meaning,
)
from taichi_erosion.tables.number_columns import own_name

RHO = "\N{GREEK SMALL LETTER RHO}"
READ = """
flux: flux (g/(m s)) -> g/(m s); sand flux g·m^-1·s^-1 -> g·m^-1·s^-1; Q (kg m⁻¹ s⁻¹) -> kg m⁻¹ s⁻¹
flux: flux in kg/(m h) -> kg/(m h)
repose_angle: Winkel der Böschung 1/° -> °; angle of repose (o) -> deg
repose_angle: angle of repose, mean ± SD (deg.) -> deg; AoR of 5 tests ° -> °
repose_angle: 休止角/(°) -> (°); 堆积角 (°) -> °
threshold_u_star: 起动摩阻风速 (m/s) -> m/s; u_*t (cm s-1) -> cm s-1
conditions.fetch: Distance from leading edge (m) -> m; Field length (m) -> m; fetch / m -> m
conditions.moisture: Humidity of sand (%) -> %; moisture before the run (%) -> %; 试验前含水率 (%) -> %
threshold_u_star: friction velocity at threshold (m/s) -> m/s; Threshold friction velocity ->
threshold_u_star: Grenzschubspannungsgeschwindigkeit ->
threshold_u_star: u*tR (m/s) -> m/s; critical u*t (m/s) -> m/s; 临界起沙摩阻风速 (m/s) -> m/s
conditions.friction_velocity: ust (m/s) -> m/s; friction velocity ->
conditions.moisture: moisture (% w/w) -> %; moisture (% (dry basis)) -> %; moisture wt.% -> %
conditions.moisture: Feuchte in mass-% -> %; Feuchte (Gew.-%) -> %; water content (g 100 g-1) -> %
conditions.moisture: moist_pct -> %; H2O [%] -> %; SM (%) -> %
conditions.pressure: Patm (kPa) -> kPa; baro (mbar) -> mbar; pressure (Torr) -> mmHg
conditions.altitude: elev. (m) -> m; Höhe ü. M. (m) -> m
conditions.moisture: moisture g/kg -> g/kg; moisture (g water/g dry soil) -> g/g
grains.size.diameter: Mean size d50 (µm, sieved) -> µm; grain size (D50) [mm] -> mm; d [mm] -> mm
grains.size.diameter: Md (mm) -> mm; Diameter, µm -> µm
conditions.width: cell thickness (mm) -> mm; Gap W (mm) -> mm
conditions.roughness_length: aerodynamic roughness length z₀ (mm) -> mm
conditions.spread: d90/d50 (-) -> 1
conditions.relative_humidity: air humidity (%) -> %; relative Luftfeuchte ->
conditions.altitude: altitude (m a.s.l.) -> m
conditions.air_density: air density (kg/m3) -> kg/m3
dynamic_angle: Ángulo de reposo dinámico (°) -> °; Angle de repos dynamique (°) -> °
conditions.friction_velocity: 剪切风速(m/s) -> m/s; Velocidad de cizalla (m/s) -> m/s
threshold_u_star: 临界剪切风速(m/s) -> m/s; Velocidade de cisalhamento limiar (m/s) -> m/s
conditions.relative_humidity: HR (%) -> %; r.F. (%) -> %; Humidité de l\u2019air (%) -> %
conditions.clay_fraction: Ton (%) -> %; Taux d\u2019argile (%) -> %; 粘土含量(%) -> %
materials.soil.density: Densidade dos grãos (kg/m3) -> kg/m3; Densité réelle (g/cm³) -> g/cm³
grains.size.diameter: d50_um -> um; D50..mm. -> mm; d_mm -> mm
threshold_u_star: u_star_t_m_s -> m/s; Threshold.friction.velocity..cm.s. -> cm/s
repose_angle: repose_angle_deg_2 -> deg
conditions.moisture: moisture.content..pct. -> %; w_g_g -> g/g
conditions.fetch: fetch_m -> m
conditions.moisture: w (% dry mass) -> %; w [% by mass] -> %; w (% d.b.) -> %
threshold_u_star: u*tw measured (m/s) -> m/s; u*t¹ (m/s) -> m/s
flux: Measured q (g/m/s) -> g/(m s); Soil transport Q (g/m/s) -> g/(m s)
conditions.pressure: Chamber pressure, mb (CO2) -> mbar
"""  # meaning: heading -> unit; ...
CHANGED = """
volumetric water content (%); water content (cm3/cm3); Feuchte (Vol.-%); 体积含水率 (%); water saturation (%)
relative moisture (%); air moisture (%); moisture increase (%); moisture (% of field capacity)
moisture, wet basis; normalised flux (g/m/s); log10 flux; u*/u*t; cos slope; repose angle ± 95% CI (deg)
moisture at sampling (%); Water sprayed (%); Anfangsfeuchte (%); humedad inicial (%); влажность до сушки (%)
Moulding water content (%); Feuchte bei Krustenbildung (%); humidité avant séchage (%); 初始含水率 (%)
u*t/u*td; AOR/AOR0; flux / bare flux; maximum grain size (mm); predicted repose angle (deg)
"""  # each another quantity than the one whose word it has
READINGS = """
repose angle (n = 5) [deg] | repose angle | deg | 5
repose angle [n=12] | repose angle |  | 12
Schüttwinkel (°, N = 3) | Schüttwinkel | ° | 3
angle of repose, mean of 4 (deg) | angle of repose, mean of | deg | 4
u*t [m/s], 3 replicates | u*t , | m/s | 3
n = 3 | n = 3 |  | 0
percent slope | percent slope | deg | 0
Slope (m/m) | Slope | deg | 0
percentile d50 | percentile d50 |  | 0
Schüttwinkel (Mittelwert) [°] | Schüttwinkel (Mittelwert) | ° | 0
T (C) | T | degC | 0
Versuch (neu) | Versuch (neu) |  | 0
"""  # heading, name, unit, repeats; the numbers of a slope in percent are turned
ROLES = """
n: Nº muestras; Nb répétitions; 样本数; Anz.; n.º de ensaios; # of runs; Число повторностей
n: replicates; Wdh.; Anzahl Wiederholungen
sd: Desv. est.; é.-t.; Standardabw. [°]; Dev. st.; Odch. stand.; s.d.; 標準偏差
sd: s; stdev; Standardabweichung; Standardabweichung Winkel
se: SD of mean; Erreur standard; 標準誤差; SEM; Standardfehler
spread: +-
remark: Notas; Obs.; 日期; Hinweis; Comentário; Anm.
"""
UNKNOWN = """
Number of passes; No. of wet-dry cycles; Anzahl Überfahrten; Cycles (n); 碾压次数
funnel diameter (mm); internal diameter (mm); wind direction (°); vertical dust flux (g/m2/s); sample mass (g)
Soil temperature (°C); 土壤温度(℃); bulk density (g/cm3)
days after spraying (d); Kontaktwinkel (°); element height (mm); Hauteur (cm)
months after inoculation; Layer No; Tapping number; Gravel diameter (mm); Snow density (kg/m3)
Moisture of straw (%); Farbe; Soluble salt in water (%); Moisture at 1.5 MPa (%); Water absorption (%)
"""


def headings(block: str) -> list[str]:
    return block.strip().replace("\n", "; ").split("; ")


@pytest.mark.parametrize("line", READ.strip().splitlines())
def test_a_heading_has_its_quantity_and_its_unit(line):
    meant, _, listed = line.partition(": ")
    for text, unit in (each.split(" ->") for each in listed.split("; ")):
        heading = read_heading(text)
        role, name = meaning_of(heading.name)
        name = meaning_of_symbol(heading)[1] if role == "unknown" else name
        assert (name, heading.unit, heading.unreadable, heading.law) == (meant, unit.strip(), "", "")
        assert qualifying_words(heading)[0] == ""


@pytest.mark.parametrize("text", headings(CHANGED))
def test_a_word_that_makes_another_quantity_is_seen(text):
    assert qualifying_words(read_heading(text))[0]


@pytest.mark.parametrize("text", headings(UNKNOWN))
def test_a_quantity_of_another_thing_is_not_read_and_not_mistaken(text):
    name = read_heading(text).name
    assert (meaning_of(name)[0], suggest_meaning(name)) == ("unknown", "")


def test_a_letter_with_a_unit_of_another_quantity_has_no_meaning_of_its_own():
    assert {meaning_of_symbol(read_heading(text))[0] for text in (f"{RHO} (g/cm3)", "d (g)")} == {"unknown"}
    assert suggest_meaning(RHO) == "materials.soil.density"


def test_a_column_has_a_name_that_its_owner_knows_again():
    names = {"Γ": "gamma", "< 63 µm (%)": "below_63_um", "植被盖度": "植被盖度", "Плотность": "плотность"}
    names |= {"Υγρασία": "υγρασία", "मिट्टी": "मिट्टी", "Grün-Anteil": "grun_anteil", "10 min": "column_10_min"}
    names |= dict.fromkeys(["θ (m3/m3)", "theta_volumetric [m3/m3]"], "theta_volumetric")
    names |= {"MgCl2·6H2O (g/m2)": "mgcl2_6h2o", "u* (m/s)": "u_star"}
    assert {heading: own_name(read_heading(heading).name, [], 2) for heading in names} == names


@pytest.mark.parametrize("line", ROLES.strip().splitlines())
def test_counts_scatter_and_remarks_are_known_in_their_languages(line):
    role, _, listed = line.partition(": ")
    assert {meaning_of(read_heading(text).name)[0] for text in headings(listed)} == {role}


def test_words_that_change_nothing_and_are_not_known_are_told():
    assert qualifying_words(read_heading("mean angle of repose of sand (loess) [deg]")) == ("", "loess")


@pytest.mark.parametrize("inside", ["g/m s", "gr/m/s", "kg/m s"])
def test_what_stands_in_brackets_as_a_unit_and_is_none_is_told(inside):
    assert read_heading(f"flux ({inside})").unreadable == inside


def test_numbers_of_a_law_are_known_by_their_heading():
    laws = {"mean grain size (phi)": "phi mm", "mesh no.": "mesh mm", "mesh size (mm)": " mm"}
    laws |= {"tangent of the angle of repose": "tan deg", "tan flux (g/m/s)": " g/(m s)"}
    laws |= {"moisture content (%, w.b.)": "wet %", "Wilgotność (% w.m.)": "wet %", "US sieve": "mesh mm"}
    assert {text: f"{read_heading(text).law} {read_heading(text).unit}" for text in laws} == laws


def test_a_bare_angle_is_that_of_repose_where_nothing_else_is_measured():
    meant = dict.fromkeys(("angle 1 [deg]", "Winkel (°)"), "repose_angle")
    meant |= dict.fromkeys(("angle (m)", "contact angle (deg)"), "")
    assert {text: meaning_of_only_angle(read_heading(text)) for text in meant} == meant


@pytest.mark.parametrize("line", READINGS.strip().splitlines())
def test_name_unit_and_count_of_repeats_are_read_wherever_they_stand(line):
    text, name, unit, repeats = line.split(" | ")
    heading = read_heading(text)
    assert (heading.name, heading.unit, heading.unreadable, heading.repeats) == (name, unit, "", int(repeats))
