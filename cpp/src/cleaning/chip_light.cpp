#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "cleaning/quantile.hpp"
#include "ocisac/cleaning/row_model.hpp"
#include "ocisac/core/require.hpp"
#include "ocisac/receiver/receive.hpp"
#include "rows/fit.hpp"

namespace ocisac {

namespace {

using Values = std::vector<double>;

constexpr double kEnough = 0.92;                          // of the rows' swing, after `levelled`, that chips explain
constexpr std::size_t kTopReach = 3, kLongestReach = 48;  // rows: half widths of a top, and of what it is compared in
constexpr double kMinTop = 0.3;                           // of the largest row within the longest run
constexpr double kKnotRows = 0.8;    // max. spacing of the knots of the response; at most a quarter of a chip
constexpr double kOwnSwing = 0.015;  // deviation of a row from the chips' model: sharpening follows no response
constexpr Eigen::Index kRowsPerTerm = 4;
constexpr double kResponseChips = 3;  // from one before a chip's ramp begins

// The largest of the values within `reach` of each.
Values largest_around(const Values& values, std::size_t reach) {
  Values result;
  for (std::size_t n = 0; n < values.size(); ++n) {
    const auto first = values.begin() + static_cast<std::ptrdiff_t>(n - std::min(n, reach));
    const auto end = values.begin() + static_cast<std::ptrdiff_t>(std::min(n + reach + 1, values.size()));
    result.push_back(*std::max_element(first, end));
  }
  return result;
}

// Rows divided by the line through the tops of bright runs, which all reach the level of full light.
Values levelled(const Values& rows) {
  Values low = rows;
  const double most = most_of_rows(rows);
  for (double& value : low) value = std::min(value, most);
  const Values near = largest_around(low, kTopReach), far = largest_around(low, kLongestReach);
  std::vector<std::size_t> tops;
  for (std::size_t n = 0; n < low.size(); ++n)
    if (low[n] >= near[n] && low[n] > kMinTop * far[n]) tops.push_back(n);
  if (tops.empty()) return rows;
  Values result(low.size());
  std::size_t next = 0;
  for (std::size_t n = 0; n < low.size(); ++n) {
    while (next < tops.size() && tops[next] < n) ++next;
    const std::size_t after = tops[std::min(next, tops.size() - 1)], before = tops[next == 0 ? 0 : next - 1];
    const double along =
        n >= after || after == before ? 1 : static_cast<double>(n - before) / static_cast<double>(after - before);
    const double start = std::log(low[n < before ? after : before]), end = std::log(low[after]);
    result[n] = low[n] / std::exp(n < before ? end : start + along * (end - start));
  }
  return result;
}

// The response of every chip to every row: a triangular basis of the time since the chip's ramp begins, from -1 to 2
// chips. Only the few chips near a row matter.
class Responses {
 public:
  Responses(std::size_t rows, std::size_t chips, double rows_per_chip, double start)
      : rows_(rows), chips_(chips), rows_per_chip_(rows_per_chip), start_(start) {
    step_ = 1 / std::ceil(std::max(4.0, rows_per_chip / kKnotRows));
    knots_ = static_cast<Eigen::Index>(std::nearbyint(kResponseChips / step_)) + 1;
  }

  [[nodiscard]] Eigen::Index knots() const { return knots_; }

  // Calls use(row, knot, value) for the values above 0 of a chip.
  template <class Use>
  void of_chip(std::size_t chip, Use use) const {
    const double begin = start_ + rows_per_chip_ * (static_cast<double>(chip) - 1 - step_);
    const double end = start_ + rows_per_chip_ * (static_cast<double>(chip) + 2 + step_);
    const double last = static_cast<double>(rows_) - 1;
    if (end < 0 || begin > last) return;
    const auto first = static_cast<std::size_t>(std::max(std::floor(begin), 0.0));
    for (std::size_t n = first; n <= static_cast<std::size_t>(std::min(std::ceil(end), last)); ++n) {
      const double since = (static_cast<double>(n) - start_) / rows_per_chip_ - static_cast<double>(chip);
      for (Eigen::Index knot = 0; knot < knots_; ++knot) {
        const double value = 1 - std::abs(since - (static_cast<double>(knot) * step_ - 1)) / step_;
        if (value > 0) use(static_cast<Eigen::Index>(n), knot, value);
      }
    }
  }

  // Adds `weight` times the response of a chip to columns of the basis from `first` on.
  void add(std::size_t chip, double weight, Eigen::Index first, Eigen::MatrixXd& basis) const {
    of_chip(chip,
            [&](Eigen::Index row, Eigen::Index knot, double value) { basis(row, first + knot) += weight * value; });
  }

  // A constant, then the sums of the chips' responses with their weights.
  [[nodiscard]] Eigen::MatrixXd basis(const Values& bits) const {
    Eigen::MatrixXd basis = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(rows_), 1 + knots_);
    basis.col(0).setOnes();
    for (std::size_t chip = 0; chip < chips_; ++chip)
      if (bits[chip] != 0) add(chip, bits[chip], 1, basis);
    return basis;
  }

  // The course that a chip adds to the rows.
  [[nodiscard]] Eigen::VectorXd course(std::size_t chip, const Eigen::VectorXd& terms) const {
    Eigen::VectorXd course = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(rows_));
    of_chip(chip, [&](Eigen::Index row, Eigen::Index knot, double value) { course[row] += value * terms[1 + knot]; });
    return course;
  }

 private:
  std::size_t rows_, chips_;
  double rows_per_chip_, start_, step_;
  Eigen::Index knots_;
};

struct ChipFit {
  Eigen::MatrixXd basis;  // (rows × terms)
  Values light;
  double rate, explained;  // chips per row
};

// Chips detected in the rows, with those cut by the ends of the picture, which are guessed.
struct DetectedChips {
  Values bits;
  std::size_t before, count;  // guessed chips before the detected ones; number of these
  double rows_per_chip, start;
};

// `refused`: flags of a reception that is none. Edges of a scene's own lines are few and fit many chip rates.
std::optional<DetectedChips> detected(const Values& rows, Flags refused) {
  const AnyFramesView view = dense_view(rows.data(), 1, rows.size(), 1);
  Camera camera;
  camera.row_time = 1;  // times are in rows
  const Received got = receive({&view, 1}, camera).front();
  if (got.bits.empty() || (got.flags & refused) != 0) return {};
  const double length = got.rows_per_chip, left = (static_cast<double>(rows.size()) - got.phase) / length;
  const auto before = static_cast<std::size_t>(std::max(std::ceil(got.phase / length), -1.0) + 1);
  const double after = std::max(std::ceil(left) - static_cast<double>(got.bits.size()), 0.0);
  DetectedChips chips{Values(before), before, got.bits.size(), length,
                      got.phase - static_cast<double>(before) * length};
  for (const char bit : got.bits) chips.bits.push_back(bit == '1' ? 1 : 0);
  chips.bits.resize(chips.bits.size() + static_cast<std::size_t>(after));
  return chips;
}

// Decides on the guessed chips, those next to the detected ones first, with the response that fits now.
void guess(const Responses& responses, const Values& rows, const Values& weight, const Eigen::VectorXd& terms,
           DetectedChips& chips, Eigen::MatrixXd& basis) {
  std::vector<std::size_t> guessed;
  for (std::size_t k = chips.before; k-- > 0;) guessed.push_back(k);
  for (std::size_t k = chips.before + chips.count; k < chips.bits.size(); ++k) guessed.push_back(k);
  for (const std::size_t k : guessed) {
    const Eigen::VectorXd shape = responses.course(k, terms);
    const Eigen::VectorXd rest = vector_of(rows) - basis * terms + chips.bits[k] * shape;
    const auto weighted = [&](const Eigen::VectorXd& values) {
      return vector_of(weight).cwiseProduct(values).dot(shape);
    };
    const double bit = 2 * weighted(rest) > weighted(shape) ? 1 : 0;
    if (bit != chips.bits[k]) responses.add(k, bit - chips.bits[k], 1, basis);
    chips.bits[k] = bit;
  }
}

Eigen::VectorXd fitted(const Eigen::MatrixXd& basis, const Values& rows, const Values& weight) {
  const Eigen::VectorXd root = vector_of(weight).array().sqrt();
  return coefficients_of(root.asDiagonal() * basis, root.cwiseProduct(vector_of(rows)));
}

// The basis with a second response, of pairs of consecutive bright chips.
Eigen::MatrixXd with_pairs(const Eigen::MatrixXd& basis, const Responses& responses, const Values& bits) {
  Eigen::MatrixXd wider = Eigen::MatrixXd::Zero(basis.rows(), basis.cols() + responses.knots());
  wider.leftCols(basis.cols()) = basis;
  for (std::size_t k = 0; k + 1 < bits.size(); ++k)
    if (bits[k] * bits[k + 1] != 0) responses.add(k, 1, basis.cols(), wider);
  return wider;
}

// Chips are detected, those cut by the ends of the picture estimated, and the response is fitted by least squares. A
// second response for pairs of consecutive bright chips allows for different rise and fall of the light. The explained
// share excludes it.
std::optional<ChipFit> fitted_chips(const Values& rows, const Values& weight, Flags refused) {
  std::optional<DetectedChips> chips = detected(rows, refused);
  if (!chips) return {};
  const Responses responses(rows.size(), chips->bits.size(), chips->rows_per_chip, chips->start);
  const auto count = static_cast<Eigen::Index>(rows.size());
  const Eigen::Index terms = 1 + responses.knots();
  if (count < kRowsPerTerm * terms) return {};
  ChipFit fit{{}, {}, 1 / chips->rows_per_chip, 0};
  Eigen::VectorXd found;
  for (int again = 0; again < 3; ++again) {
    fit.basis = responses.basis(chips->bits);
    found = fitted(fit.basis, rows, weight);
    guess(responses, rows, weight, found, *chips, fit.basis);
  }
  fit.explained = explained_share(rows, values_of(fit.basis * found), weight);
  if (count >= kRowsPerTerm * (terms + responses.knots())) {
    fit.basis = with_pairs(fit.basis, responses, chips->bits);
    found = fitted(fit.basis, rows, weight);
  }
  fit.light = values_of(fit.basis * found);
  return fit;
}

}  // namespace

std::optional<ModelledLight> find_chip_light(const ColumnBundles& picture, const RowLight& rows, bool always) {
  require(rows.light.size() == picture.rows() && rows.information.size() == picture.rows(), "rows", rows.light.size(),
          "one value a row");
  const Flags refused = flag::no_signal | flag_if(!always, flag::too_few_edges);
  const std::optional<ChipFit> best = fitted_chips(levelled(rows.light), rows.information, refused);
  if (!best || (!always && best->explained < kEnough)) return {};
  Values light = fully_modulated_rows(best->light);
  const RowLightPrior within{.basis = span_of(best->basis)};
  for (int again = 0; again < 2; ++again) {
    const Values start = values_of(best->basis * coefficients_of(best->basis, vector_of(light)));
    light = fully_modulated_rows(picture.refined(start, within).light);
  }
  light = fully_modulated_rows(picture.refined(light, {.basis = {}, .deviation = kOwnSwing}).light);
  const double full = quantile(light, kBrightRows);
  return ModelledLight{std::move(light), full, RowModel::chips, best->rate, {}};
}

double unexplained_by_chips(const RowLight& rows) {
  const std::optional<ChipFit> fit = fitted_chips(levelled(rows.light), rows.information, flag::no_signal);
  return fit ? 1 - fit->explained : 1;
}

}  // namespace ocisac
