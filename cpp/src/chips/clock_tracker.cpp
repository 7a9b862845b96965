#include "ocisac/chips/clock_tracker.hpp"

#include <Eigen/Core>
#include <Eigen/LU>
#include <cmath>

#include "core/levels.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"

namespace ocisac {

namespace {

using Matrix3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
using Matrix2 = Eigen::Matrix2d;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kMinVariance = 1e-18;  // rows²; lower bound for frames without noise

struct State {
  Vector3d mean;
  Matrix3 covariance;
  std::int64_t chip;
};

// Predicts some frames ahead, for the chip that begins nearest row 0 there.
State forwarded(const State& from, double frames, const TrackerOptions& options) {
  const double rows = frames * from.mean[2] - from.mean[0];  // from the chip's beginning to the new frame's
  const double chips = std::nearbyint(rows / from.mean[1]);
  Matrix3 step = Matrix3::Identity();
  step(0, 1) = chips;
  step(0, 2) = -frames;
  State to{step * from.mean, step * from.covariance * step.transpose(), from.chip + std::llround(chips)};
  // Random walk of the rate; its contribution to the phase is the integral.
  const double walk = std::pow(options.drift * from.mean[1], 2) * frames;
  to.covariance(1, 1) += walk;
  to.covariance(0, 1) += 0.5 * walk * chips;
  to.covariance(1, 0) += 0.5 * walk * chips;
  to.covariance(0, 0) += walk * chips * chips / 3;
  return to;
}

// Covariance of the measured phase of chip 0 and rows per chip, from that at the middle chip of the fit.
Matrix2 measured_covariance(const ClockErrors& errors) {
  const auto& c = errors.covariance;
  const auto away = -static_cast<double>(errors.chip);
  Matrix2 at, move;
  at << c[0], c[1], c[3], c[4];
  move << 1, away, 0, 1;
  Matrix2 moved = move * at * move.transpose();
  moved.diagonal().array() += kMinVariance;
  return moved;
}

constexpr double kMaxJitteredCount = 1;  // chips, standard error of the count where starts jitter
constexpr double kSmallJump = 0.25;      // chips; the count of chips stays sure
constexpr double kSteadyKept = 0.3;      // where the clock is as steady as it is measured
constexpr int kSteady = 2;               // updates; jumps that follow each other closer are jitter

}  // namespace

ClockTracker::ClockTracker(const TrackerOptions& options) : options_(options) {
  require_positive("frame_rows", options.frame_rows);
  require_not_negative("frame_rows_std", options.frame_rows_std);
  require_not_negative("drift", options.drift);
  require_not_negative("exposure_wander", options.exposure_wander);
  reset();
}

void ClockTracker::reset() {
  started_ = false;
  jitter_variance_ = 0;
  steady_ = 0;
  state_ = {0, 0, options_.frame_rows};
  covariance_ = {};
  covariance_[8] = options_.frame_rows_std * options_.frame_rows_std;
}

void ClockTracker::set_frame_rows(double rows, double standard_error) {
  options_.frame_rows = state_[2] = rows;
  options_.frame_rows_std = standard_error;
  Eigen::Map<Matrix3> covariance(covariance_.data());
  covariance.row(2).setZero();
  covariance.col(2).setZero();
  covariance(2, 2) = standard_error * standard_error;
  jitter_variance_ = 0;
  steady_ = 0;
}

void ClockTracker::begin(double frame, const ChipClock& clock, const ClockErrors& errors) {
  const Matrix2 measured = measured_covariance(errors);
  started_ = true;
  frame_ = frame;
  chip_ = 0;
  state_ = {clock.phase, clock.rows_per_chip, state_[2]};
  Eigen::Map<Matrix3> covariance(covariance_.data());
  const double frame_rows_variance = covariance(2, 2);
  covariance.setZero();
  covariance.topLeftCorner<2, 2>() = measured;
  covariance(0, 0) += jitter_variance_;
  covariance(2, 2) = frame_rows_variance;  // the camera's own
  exposure_ = clock.exposure_rows;
  exposure_variance_ = errors.covariance[8];
}

bool ClockTracker::update(double frame, const ChipClock& clock, const ClockErrors& errors) {
  require_positive("rows_per_chip", clock.rows_per_chip);
  require_finite("frame", frame);
  require_finite("phase", clock.phase);
  require_not_negative("exposure_rows", clock.exposure_rows);
  for (std::size_t k : {0U, 1U, 3U, 4U}) require_finite("covariance", errors.covariance[k]);
  if (!started_) {
    begin(frame, clock, errors);
    return true;
  }
  require(frame > frame_, "frame", frame, "a frame after the last one");
  if (!counts_to(frame)) {
    begin(frame, clock, errors);
    return false;
  }
  State here =
      forwarded({Eigen::Map<const Vector3d>(state_.data()), Eigen::Map<const Matrix3>(covariance_.data()), chip_},
                frame - frame_, options_);
  // Selects the measured chip that begins nearest to the predicted one.
  const double away = std::nearbyint((here.mean[0] - clock.phase) / clock.rows_per_chip);
  ClockErrors shifted = errors;
  shifted.chip -= static_cast<std::ptrdiff_t>(away);
  Matrix2 noise = measured_covariance(shifted);
  noise(0, 0) += jitter_variance_;
  const Vector2d seen(clock.phase + away * clock.rows_per_chip, clock.rows_per_chip);
  const Vector2d innovation = seen - here.mean.head<2>();
  Matrix2 expected = here.covariance.topLeftCorner<2, 2>() + noise;
  const auto is_lost = [&] { return innovation.dot(expected.inverse() * innovation) > kLostErrors * kLostErrors; };
  const double squared = innovation[0] * innovation[0];
  const bool steady = squared < kWeak * kWeak * (expected(0, 0) - jitter_variance_);
  const bool same_rate = innovation[1] * innovation[1] < kLostErrors * kLostErrors * expected(1, 1);
  const bool jitters = std::sqrt(squared) < kSmallJump * clock.rows_per_chip || steady_ < kSteady;
  if (is_lost() && same_rate && jitters) {
    const double more = std::max(squared - jitter_variance_, 0.0);
    if (jitter_variance_ == 0) {  // the start that the clock was begun with jittered, too
      here.covariance(0, 0) += more;
      expected(0, 0) += more;
    }
    jitter_variance_ += more;
    noise(0, 0) += more;
    expected(0, 0) += more;
  }
  steady_ = steady ? steady_ + 1 : 0;
  const double max_lost = jitter_variance_ > 0 ? kMaxJitteredCount : kCountLost;
  const bool count_lost = std::sqrt(here.covariance(0, 0)) > max_lost * here.mean[1];
  if (count_lost || is_lost()) {
    begin(frame, clock, errors);
    return false;
  }
  if (jitter_variance_ > 0) {
    const double unexpected = squared - (expected(0, 0) - jitter_variance_);
    jitter_variance_ = steady ? kSteadyKept * jitter_variance_
                              : std::max(kNearlyAll * jitter_variance_ + (1 - kNearlyAll) * unexpected, 0.0);
  }
  const Eigen::Matrix<double, 3, 2> gain = here.covariance.leftCols<2>() * expected.inverse();
  Eigen::Map<Vector3d>(state_.data()) = here.mean + gain * innovation;
  Matrix3 kept = Matrix3::Identity();
  kept.leftCols<2>() -= gain;
  Eigen::Map<Matrix3>(covariance_.data()) =
      kept * here.covariance * kept.transpose() + gain * noise * gain.transpose();  // stays symmetric
  const double wander = std::pow(options_.exposure_wander * exposure_, 2) * (frame - frame_);
  const double before = exposure_variance_ + wander, now = errors.covariance[8];
  if (!std::isfinite(before)) {
    exposure_ = clock.exposure_rows;
    exposure_variance_ = now;
  } else if (std::isfinite(now) && before + now > 0) {
    exposure_ += before / (before + now) * (clock.exposure_rows - exposure_);
    exposure_variance_ = before * now / (before + now);
  }
  frame_ = frame;
  chip_ = here.chip;
  return true;
}

// False after a pause of more chips than doubles count.
bool ClockTracker::counts_to(double frame) const {
  return (frame - frame_) * std::abs(state_[2]) < kMostCounted * state_[1];
}

std::optional<TrackedClock> ClockTracker::predict(double frame) const {
  if (!started_) return std::nullopt;
  require(frame >= frame_, "frame", frame, "not before the last update");
  if (!counts_to(frame)) return std::nullopt;
  const State there =
      forwarded({Eigen::Map<const Vector3d>(state_.data()), Eigen::Map<const Matrix3>(covariance_.data()), chip_},
                frame - frame_, options_);
  const double wander = std::pow(options_.exposure_wander * exposure_, 2) * (frame - frame_);
  const auto& c = there.covariance;
  return TrackedClock{
      {there.mean[1], there.mean[0], exposure_},
      there.chip,
      {0, {c(0, 0) + jitter_variance_, c(0, 1), 0, c(1, 0), c(1, 1), 0, 0, 0, exposure_variance_ + wander}},
      std::sqrt(c(0, 0)) / there.mean[1]};
}

}  // namespace ocisac
