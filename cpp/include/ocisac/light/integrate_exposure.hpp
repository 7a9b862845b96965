// The light that the rows of a rolling shutter collect from a waveform.
#pragma once

#include <cstdint>
#include <span>

#include "ocisac/camera/camera.hpp"
#include "ocisac/core/views.hpp"
#include "ocisac/light/waveform.hpp"

namespace ocisac {

// Mean light over the exposure of each row, eq. 4 divided by A·T_e (steady light has gain 1):
//
//   out[i] = (1/T_e)·∫ waveform over [t − T_e, t],   t = start + frame·frame_time + rows[i]·row_time
//
// and the light at t itself for T_e = 0. Exact by antiderivative: a tone is A/2·(1 + depth·sinc(f T_e)·cos(phase in
// mid-exposure)), chips and samples are prefix sums and two cut ends, products are prefix sums over the pieces between
// edges, on each of which (c0 + c1 u)·cos(w u + phase) has a closed form. Instants and counts of cycles are formed from
// the indices in double-double, so the error stays near 1e-13 of the waveform's amplitude however late the frame.
//
// rows: row numbers in any order, negative ones too. out: as many values. start in seconds. The camera's exposure must
// be known, and its frame time where frame is not 0. Run time is proportional to the rows, for products also to the
// pieces.
void integrate_exposure(const Waveform& waveform, const Camera& camera, std::span<const std::int64_t> rows,
                        double start, std::int64_t frame, std::span<double> out);

// The same for several frames; out: one frame of (frames × rows).
void integrate_exposure(const Waveform& waveform, const Camera& camera, std::span<const std::int64_t> rows,
                        double start, std::span<const std::int64_t> frames, const FramesView<double>& out);

// The waveform's value at each of the times (s).
void sample_waveform(const Waveform& waveform, std::span<const double> times, std::span<double> out);

}  // namespace ocisac
