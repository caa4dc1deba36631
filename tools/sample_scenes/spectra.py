"""Spectra to linear Rec.709, for the measured reflectances of the Cornell box.

Colour matching functions: the multi-lobe fit to CIE 1931 of Wyman, Sloan and Shirley, "Simple Analytic Approximations to the
CIE XYZ Color Matching Functions" (JCGT 2013), eq. 4, good to about 1 %.
"""

from math import exp

# Cornell University Program of Computer Graphics, "Cornell Box Data": 400 nm to 700 nm in steps of 4 nm.
WHITE = """.343 .445 .551 .624 .665 .687 .708 .723 .715 .710 .745 .758 .739 .767 .777 .765 .751 .745 .748 .729 .745 .757 .753 .750
.746 .747 .735 .732 .739 .734 .725 .721 .733 .725 .732 .743 .744 .748 .728 .716 .733 .726 .713 .740 .754 .764 .752 .736 .734 .741
.740 .732 .745 .755 .751 .744 .731 .733 .744 .731 .712 .708 .729 .730 .727 .707 .703 .729 .750 .760 .751 .739 .724 .730 .740 .737"""
GREEN = """.092 .096 .098 .097 .098 .095 .095 .097 .095 .094 .097 .098 .096 .101 .103 .104 .107 .109 .112 .115 .125 .140 .160 .187
.229 .285 .343 .390 .435 .464 .472 .476 .481 .462 .447 .441 .426 .406 .373 .347 .337 .314 .285 .277 .266 .250 .230 .207 .186 .171
.160 .148 .141 .136 .130 .126 .123 .121 .122 .119 .114 .115 .117 .117 .118 .120 .122 .128 .132 .139 .144 .146 .150 .152 .157 .159"""
RED = """.040 .046 .048 .053 .049 .050 .053 .055 .057 .056 .059 .057 .061 .061 .060 .062 .062 .062 .061 .062 .060 .059 .057 .058
.058 .058 .056 .055 .056 .059 .057 .055 .059 .059 .058 .059 .061 .061 .063 .063 .067 .068 .072 .080 .090 .099 .124 .154 .192 .255
.287 .349 .402 .443 .487 .513 .558 .584 .620 .606 .609 .651 .612 .610 .650 .638 .627 .620 .630 .628 .642 .639 .657 .639 .635 .642"""
# The lamp's spectrum at 400, 500, 600 and 700 nm, in the publication's own unit.
LAMP = (0.0, 8.0, 15.6, 18.4)
# "The reflectance of the light source was measured to be 0.78."
LAMP_REFLECTANCE = 0.78

WAVELENGTHS = range(400, 701, 4)


def table(text: str) -> list[float]:
    values = [float(v) for v in text.split()]
    assert len(values) == len(WAVELENGTHS), len(values)
    return values


def lamp() -> list[float]:
    """The lamp's radiance at every tabulated wavelength, linear between the four that were published."""
    out = []
    for nm in WAVELENGTHS:
        k = min((nm - 400) // 100, 2)
        t = (nm - 400 - 100 * k) / 100
        out.append(LAMP[k] * (1 - t) + LAMP[k + 1] * t)
    return out


def matching(nm: float) -> tuple[float, float, float]:
    """x, y, z of the CIE 1931 observer."""

    def lobe(scale: float, centre: float, below: float, above: float) -> float:
        t = (nm - centre) * (below if nm < centre else above)
        return scale * exp(-0.5 * t * t)

    x = lobe(0.362, 442.0, 0.0624, 0.0374) + lobe(1.056, 599.8, 0.0264, 0.0323) + lobe(-0.065, 501.1, 0.0490, 0.0382)
    y = lobe(0.821, 568.8, 0.0213, 0.0247) + lobe(0.286, 530.9, 0.0613, 0.0322)
    z = lobe(1.217, 437.0, 0.0845, 0.0278) + lobe(0.681, 459.0, 0.0385, 0.0725)
    return x, y, z


def rgb(spectrum: list[float]) -> tuple[float, float, float]:
    """Linear Rec.709 of a radiance spectrum, such that the luminance is its mean weighted by y."""
    total = [0.0, 0.0, 0.0]
    weight = 0.0
    for nm, value in zip(WAVELENGTHS, spectrum):
        m = matching(nm)
        weight += m[1]
        for k in range(3):
            total[k] += value * m[k]
    x, y, z = (v / weight for v in total)
    return (
        3.2404542 * x - 1.5371385 * y - 0.4985314 * z,
        -0.9692660 * x + 1.8760108 * y + 0.0415560 * z,
        0.0556434 * x - 0.2040259 * y + 1.0572252 * z,
    )


def lamp_rgb() -> tuple[float, float, float]:
    """The lamp's radiance in RGB."""
    r, g, b = rgb(lamp())
    return round(r, 4), round(g, 4), round(b, 4)


def albedo(text: str) -> tuple[float, float, float]:
    """The RGB albedo that gives the measured spectrum's colour under the lamp itself."""
    light = lamp()
    lit = rgb([a * b for a, b in zip(table(text), light)])
    white = rgb(light)
    r, g, b = (max(c / w, 0.0) for c, w in zip(lit, white))
    return round(r, 4), round(g, 4), round(b, 4)
