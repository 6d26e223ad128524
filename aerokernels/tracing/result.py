"""The result of a trace: per-ray arrays, statuses and the error budget."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..device_arrays import DeviceArray, read_on_touch
from ..display.quantities import ErrorBudget, Quantity, unknown
from ..display.shown import drawn_on, shown
from ..inputs.arguments import checked
from ..process.clock import clocked, stage
from ..pupils import transverse_axes
from .plan import RAY_OUTPUTS
from .stop import RayStatus, reached

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

    from .variants.causes import Variants

# Names that `on_device` accepts.
ON_DEVICE = (*RAY_OUTPUTS, "status", "start_position", "start_direction")


# What is computed when it is first read, as RAY_OUTPUTS.
COMPUTED = {
    "group_path": ("m", "integral of the group index ds from the start to the stop"),
    "transmission": ("1", "share of the power that the gas does not absorb"),
    "truncation": ("m", "OPD that the ray lacks because its field was cut from a larger one"),
}


def _rms(opd: np.ndarray, share: np.ndarray) -> float:
    """Return the rms about the mean of optical path differences with weights, both (n,)."""
    # Not by BLAS, whose last bits depend on the number of threads.
    mean = np.sum(share * opd) / np.sum(share)
    return float(np.sqrt(np.sum(share * (opd - mean) ** 2) / np.sum(share)))


@shown
@read_on_touch(*RAY_OUTPUTS, "traced_status", "start_position", "start_direction")
@dataclass(eq=False, repr=False)
class TraceResult:
    """Traced rays, in float64 whatever the kernel's precision. Arrays that were not requested are None.

    Results of Warp stay on its device: `on_device` returns them there, and an attribute is copied to the host when it
    is first read. A pickle contains the host's copies.

    Attributes:
        position: End points [m], shape (ray_count, 3).
        direction: Unit tangents at the stop, shape (ray_count, 3).
        optical_path: Integral of n ds [m], shape (ray_count,): what the phase travels. A pulse travels `group_path`.
        opd: Optical path less ambient_index times the distance at which the undisturbed ray meets the same stop [m].
            For a ray that did not reach the stop the same length of ambient path is subtracted.
        arc_length: Length of the ray [m].
        step_error: OPD error of the steps, estimated by the embedded formula [m].
        step_count: Accepted steps.
        evaluation_count: Field evaluations.
        traced_status: RayStatus codes set by the tracer, first failure wins; `status` adds LEFT_DISTURBED_AIR.
        plan: The choices made for this trace, with reasons.
        seconds: Wall time by stage: see STAGES in clock.py.
        wavelength: Wavelength of the tolerance [m].
        weight: Share of each ray in means over the bundle.
        start_position: Where the rays start [m], shape (ray_count, 3).
        start_direction: Their unit tangents there, shape (ray_count, 3).
    """

    traced_status: np.ndarray
    plan: Any
    seconds: dict[str, float]
    wavelength: float
    weight: np.ndarray
    position: np.ndarray | None = None
    direction: np.ndarray | None = None
    optical_path: np.ndarray | None = None
    opd: np.ndarray | None = None
    arc_length: np.ndarray | None = None
    step_error: np.ndarray | None = None
    step_count: np.ndarray | None = None
    evaluation_count: np.ndarray | None = None
    varied: Any = field(default=None, repr=False)
    lost: Any = field(default=None, repr=False)
    group: Any = field(default=None, repr=False)
    absorbed: Any = field(default=None, repr=False)
    start_position: np.ndarray | None = None
    start_direction: np.ndarray | None = None

    @property
    def ray_count(self) -> int:
        """Number of rays."""
        return len(self.__dict__["traced_status"])

    def on_device(self, name: str) -> Any:
        """Return an output, "status", "start_position" or "start_direction" where it is stored, without a copy.

        Results of Warp are a warp.array of numbers or vectors; those of OpenCL and of the reference are NumPy arrays.
        Both support DLPack, and arrays on a GPU have `__cuda_array_interface__`: CuPy, PyTorch and JAX accept them as
        they are (`torch.from_dlpack(result.on_device("opd"))`). "status" holds the tracer's codes, as `traced_status`.

        Raises:
            ValueError: No such output, or one that was not requested.
        """
        found = self.__dict__.get("traced_status" if name == "status" else name) if name in ON_DEVICE else None
        if found is None:
            there = ", ".join(each for each in ON_DEVICE if each == "status" or self.__dict__.get(each) is not None)
            raise ValueError(f"{name!r} is not among the outputs: this result has {there}")
        return found.buffer if isinstance(found, DeviceArray) else found

    @cached_property
    def group_path(self) -> np.ndarray | None:
        """Integral of the group index n - lambda dn/dlambda [m], shape (ray_count,), by which a pulse travels.

        It is the optical path in a field whose group index is not known: one of raw contrast. None where not both
        `optical_path` and `arc_length` are among the outputs. Computed when first read.
        """
        if self.optical_path is None or self.arc_length is None:
            return None
        return self.optical_path if self.group is None else np.asarray(self.group(self))

    @cached_property
    def transmission(self) -> np.ndarray:
        """The share of each ray's power that the gas does not absorb, exp(-integral of kappa ds), shape (ray_count,).

        It is 1 in a field without `IndexField.with_absorption`, and NaN for rays that failed. Computed when first read,
        along the traced path; parts of it are traced again for that.
        """
        return np.ones(self.ray_count) if self.absorbed is None else np.asarray(self.absorbed(self))

    @cached_property
    def truncation(self) -> np.ndarray:
        """The OPD that each ray lacks because its field was cut from a larger one [m], signed, shape (ray_count,).

        It is the integral of the source's contrast outside the field's box, see cuts.py; zero for a field whose box is
        its whole flow. Integrated along straight lines or, where the field bends rays by more than a cell, along the
        tangents at the traced ends, if both `position` and `direction` were requested. Computed when first read.
        """
        return np.zeros(self.ray_count) if self.lost is None else np.asarray(self.lost(self))

    @property
    def ends(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Where the rays ended [m] and their directions there, both (ray_count, 3); None if not both were requested."""
        return None if self.position is None or self.direction is None else (self.position, self.direction)

    @cached_property
    def status(self) -> np.ndarray:
        """RayStatus codes, first failure wins, shape (ray_count,).

        Rays with LEFT_DISTURBED_AIR reached the stop, but lack more than the tolerance of OPD: see `truncation`.
        Computed when first read.
        """
        status = np.array(self.traced_status)
        if self.lost is not None:
            tolerance = self.plan.tolerance * self.wavelength
            doubtful = (status == RayStatus.OK) & (np.abs(self.truncation) > tolerance)
            status[doubtful] = RayStatus.LEFT_DISTURBED_AIR
        return status

    @property
    def ok(self) -> np.ndarray:
        """Which rays reached the stop, shape (ray_count,).

        These are the rays of status OK, LEFT_DISTURBED_AIR and TOLERANCE_NOT_MET; `status` says which is which.
        """
        return reached(self.traced_status)

    @cached_property
    def variants(self) -> "Variants | None":
        """How some of the rays change by each cause of an error (variants/causes.py); None where no ray arrived.

        Computed when first read.
        """
        return None if self.varied is None else self.varied(self)

    @cached_property
    def error(self) -> ErrorBudget:
        """The error of a ray's optical path difference [m], by cause and in "total".

        It is the root mean square over some of the rays, and covers that of 95 rays in 100. "refractivity" is that of
        differences from the bundle's mean. It is computed when first read, in the time seconds["error"].
        """
        with clocked() as spent, stage("error"):
            found = unknown("m")
            if self.variants is not None:
                from .variants.causes import of_a_ray

                about_mean = {"refractivity": lambda rays: rays.opd - rays.opd.mean()}
                found = of_a_ray(lambda rays: rays.opd, self.variants, "m", about_mean)
        self.seconds["error"] = spent["total"]
        return found

    @cached_property
    def quantities(self) -> dict[str, Quantity]:
        """The bundle's numbers with their errors: "opd_rms" [m], where "opd" is among the outputs.

        "opd_rms" is the rms of the OPD about its mean over the rays that reached the stop, weighted by their shares of
        the bundle; NaN where no ray reached it.
        """
        good = self.ok
        if self.opd is None:
            return {}
        if not good.any():
            return {"opd_rms": Quantity(float("nan"), unit="m")}
        share = np.broadcast_to(self.weight, good.shape)[good]
        error = float("nan")
        if (found := self.variants) is not None:
            from .variants.causes import budget

            error = budget(lambda rays: _rms(rays.opd, found.weight), found, "m")["total"]
        return {"opd_rms": Quantity(_rms(self.opd[good], share), error, "m")}

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw the spot diagram, the ray directions about their mean [urad], on matplotlib axes; returns the axes.

        Raises:
            ValueError: `direction` is not among the outputs, or no ray reached the stop.
        """
        if self.direction is None or not self.ok.any():
            raise ValueError("a spot diagram needs the output direction, and rays that reached the stop")
        axes = drawn_on(axes)
        axes.plot(*self._spots(), ".", markersize=2)
        axes.set(xlabel="angle from the mean, first axis [urad]", ylabel="second axis [urad]", aspect="equal")
        return axes

    def _spots(self) -> tuple[np.ndarray, np.ndarray]:
        assert self.direction is not None
        there = self.direction[self.ok]
        mean = there.mean(axis=0)
        first, second = transverse_axes(mean / np.linalg.norm(mean))
        return 1e6 * (there @ first), 1e6 * (there @ second)

    def _picture(self) -> Any:
        from ..display.figures import Axis, Line, Lines

        if self.direction is None or not self.ok.any():
            return None
        x, y = (one[:: max(len(one) // 500, 1)] for one in self._spots())
        first, second = (Axis(f"angle from the mean, {name} axis [µrad]") for name in ("first", "second"))
        return Lines(first, second, [Line(x, y, dots=True)])

    def __repr__(self) -> str:
        """Rays, their status, the OPD with its error and the plan.

        Reading `error` for the first time traces some rays again.
        """
        status = ", ".join(f"{count} {name}" for name, count in self.status_summary().items()) or "none"
        lines = [f"TraceResult of {self.ray_count} rays: {status}"]
        lines += [f"  OPD rms {rms.scaled(1e9, 'nm')}" for rms in self.quantities.values()]
        return "\n".join([*lines, f"  {str(self.plan).splitlines()[0]}"])

    def status_summary(self) -> dict[str, int]:
        """Number of rays of each status that occurs, by the status's name."""
        code, count = np.unique(self.status, return_counts=True)
        return {RayStatus(int(c)).name: int(n) for c, n in zip(code, count, strict=True)}

    def to_xarray(self) -> "xarray.Dataset":
        """The result as an xarray.Dataset with units, the OPD's error budget among its attributes.

        `result.to_xarray().to_netcdf(path)` saves it, and `TraceResult.open(path)` opens it.
        """
        import xarray

        variables: dict[str, tuple] = {}
        starts = {"start_position": ("m", "position at the start"), "start_direction": ("1", "direction at the start")}
        for name, (unit, meaning) in {**RAY_OUTPUTS, **COMPUTED, **starts}.items():
            array = getattr(self, name)
            if array is not None:
                dims = ("ray", "axis") if array.ndim == 2 else ("ray",)
                variables[name] = (dims, array, {"units": unit, "long_name": meaning})
        codes = " ".join(f"{int(s)}={s.name}" for s in RayStatus)
        variables["status"] = (("ray",), self.status, {"long_name": f"ray status: {codes}"})
        variables["weight"] = (("ray",), self.weight, {"units": "1", "long_name": "share of the bundle"})
        attributes = {"wavelength": self.wavelength, "wavelength_units": "m", "plan": str(self.plan)}
        if "opd" in variables:
            rms = self.quantities["opd_rms"].error
            attributes |= {"causes": " ".join(self.error), "opd_error": [*self.error.values()], "opd_rms_error": rms}
        return xarray.Dataset(variables, coords={"axis": ["x", "y", "z"]}, attrs=attributes)

    @classmethod
    @checked
    def open(cls, path: str | Path) -> "TraceResult":
        """Open the NetCDF file of a result, which `result.to_xarray().to_netcdf(path)` wrote.

        All arrays and errors are those of the file; `plan` is its text, and nothing can be traced again.

        Raises:
            ValueError: A file that does not exist, is damaged, or is of something else.
        """
        from ..files.netcdf_reading import open_netcdf

        data = open_netcdf(Path(path), str(path), whole=True)
        if not {"status", "weight"} <= set(data.variables) or not {"wavelength", "plan"} <= set(data.attrs):
            raise ValueError(f"{path} is no file of TraceResult.to_xarray: it lacks status, weight, wavelength or plan")
        arrays = {str(name): np.asarray(one) for name, one in data.data_vars.items()}
        own = {name: array for name, array in arrays.items() if name in ON_DEVICE and name != "status"}
        found = cls(arrays["status"], data.attrs["plan"], {}, float(data.attrs["wavelength"]), arrays["weight"], **own)
        vars(found).update({name: arrays[name] for name in COMPUTED if name in arrays}, error=unknown("m"))
        if "opd_error" in data.attrs:
            found.error.update(zip(str(data.attrs["causes"]).split(), map(float, data.attrs["opd_error"]), strict=True))
            rms, error = found.quantities["opd_rms"], float(data.attrs["opd_rms_error"])
            found.quantities["opd_rms"] = replace(rms, error=error)
        return found
