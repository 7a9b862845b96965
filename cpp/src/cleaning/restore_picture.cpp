#include "ocisac/cleaning/restore_picture.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "cleaning/block_shares.hpp"
#include "cleaning/merged_blocks.hpp"
#include "cleaning/restoring_kernels.hpp"
#include "core/check_interrupt.hpp"
#include "ocisac/core/constants.hpp"

namespace ocisac {

namespace {

template <class Sample>
void check(const FramesView<const Sample>& stored, const StoredTable& table) {
  require(stored.frames == 1 && stored.columns > 0 && stored.rows > 0, "stored", stored.frames, "one frame");
  require(!table.light.empty() && table.variance.size() == table.light.size(), "variance", table.variance.size(),
          "one for each stored value");
  if (table.light.size() > std::numeric_limits<Sample>::max()) return;
  for (std::size_t row = 0; row < stored.rows; ++row)
    for (std::size_t column = 0; column < stored.columns; ++column) {
      const std::size_t value = stored(0, row, column);
      require(value < table.light.size(), "stored", value, "a value of the table");
    }
}

// Stored values under gains: those whose neighbourhood contains their light. Where one would burn, rows that were lit
// more do burn: below them is the brightest that is known.
template <class Sample>
class RestoredValues {
 public:
  RestoredValues(const StoredTable& table, double max_gain)
      : light_(table.light), bounds_(table.bounds), max_gain_(max_gain) {
    const auto brightest = static_cast<std::size_t>(
        std::ranges::find_if_not(table.variance, [](double value) { return std::isfinite(value); }) -
        table.variance.begin());
    highest_ = brightest - std::min<std::size_t>(brightest, 1);
    for (std::size_t k = 0; k < light_.size(); ++k)
      if (!std::isfinite(table.variance[k])) light_[k] = kInfinity;
    const double first = table.light.front(), width = std::max(table.light.back() - first, 1e-300) / kCells;
    cells_ = {first, 1 / width, kCells};
    const auto highest = bounds_.begin() + static_cast<std::ptrdiff_t>(highest_);
    const auto value_at = [&](double cell) {
      return static_cast<std::size_t>(std::upper_bound(bounds_.begin(), highest, first + width * cell) -
                                      bounds_.begin());
    };
    for (std::size_t k = 0; k < kCells; ++k) {
      const double cell = static_cast<double>(k);
      const std::size_t start = value_at(cell - kRounding), end = value_at(cell + 1 + kRounding);
      starts_.push_back(static_cast<std::uint32_t>(start) | (end > start + 1 ? kSearched : 0));
      next_.push_back(start < end ? bounds_[start] : kInfinity);
    }
    starts_.push_back(static_cast<std::uint32_t>(highest_) | kSearched);
    next_.push_back(kInfinity);
  }

  // A row.
  void restore(std::span<const Sample> stored, kernels::RowGain row, std::span<const double> share, Sample* restored,
               std::uint8_t* marks) {
    row.most = max_gain_;
    lit_.resize(stored.size());
    cell_.resize(stored.size());
    for (std::size_t i = 0; i < stored.size(); ++i) lit_[i] = light_[stored[i]];
    kernels::apply_gains(row, cells_, stored.size(), share.data(), {lit_.data(), cell_.data(), marks});
    for (std::size_t i = 0; i < stored.size(); ++i) {
      const auto cell = static_cast<std::size_t>(cell_[i]);
      const std::uint32_t start = starts_[cell];
      restored[i] = static_cast<Sample>(start + (lit_[i] >= next_[cell] ? 1 : 0));
      marks[i] = static_cast<std::uint8_t>(marks[i] * static_cast<std::uint8_t>(PixelMark::dark));
      if ((start & kSearched) == 0) continue;
      if (light_[stored[i]] == kInfinity) {
        restored[i] = stored[i];
        marks[i] = static_cast<std::uint8_t>(PixelMark::saturated);
      } else {
        restored[i] = static_cast<Sample>(searched(cell, lit_[i]));
      }
    }
  }

 private:
  static constexpr std::size_t kCells = 4096;
  static constexpr double kRounding = 1e-6;                            // of a cell
  static constexpr std::uint32_t kSearched = std::uint32_t{1} << 31U;  // cells of several values, or of none

  // From where the value is if those of the cell lie at equal distances.
  [[nodiscard]] std::size_t searched(std::size_t cell, double light) const {
    const auto start_of = [&](std::size_t k) { return static_cast<std::size_t>(starts_[k] & ~kSearched); };
    const std::size_t start = start_of(cell), end = start_of(std::min(cell + 1, kCells));
    const double within = (light - cells_.first) * cells_.per_light - static_cast<double>(cell);
    std::size_t value =
        start + static_cast<std::size_t>(std::clamp(within, 0.0, 1.0) * static_cast<double>(end - start));
    while (value > 0 && light < bounds_[value - 1]) --value;
    while (value < highest_ && light >= bounds_[value]) ++value;
    return value;
  }

  std::vector<double> light_;       // infinite where saturated
  std::span<const double> bounds_;  // of each value: below the next one
  double max_gain_;
  std::size_t highest_;
  kernels::LightCells cells_{};
  std::vector<std::uint32_t> starts_;  // lowest value of each cell
  std::vector<double> next_;           // light at which the next value follows
  std::vector<double> lit_;
  std::vector<std::int32_t> cell_;
};

}  // namespace

bool BlockShares::is_one() const {
  return std::ranges::all_of(share, [&](double other) { return other == share.front(); });
}

template <class Sample>
Blocks merge_columns(const FramesView<const Sample>& stored, std::size_t merged, const StoredTable& table) {
  check(stored, table);
  require(merged > 0, "merged", merged, "1 or more");
  struct Entry {
    double light, variance, known;
  };
  std::vector<Entry> entries;
  for (std::size_t k = 0; k < table.light.size(); ++k) {
    const bool known = std::isfinite(table.variance[k]);
    entries.push_back({known ? table.light[k] : 0, known ? table.variance[k] : 0, known ? 1.0 : 0.0});
  }
  const std::size_t rows = stored.rows, columns = stored.columns, blocks = blocks_of(columns, merged);
  Blocks result{rows, blocks, std::vector<double>(rows * blocks), std::vector<double>(rows * blocks)};
  std::size_t to = 0;
  for (std::size_t row = 0; row < rows; ++row) {
    check_interrupt();
    for (std::size_t first = 0; first < columns; first += merged, ++to) {
      Entry sum{0, 0, 0};
      for (std::size_t column = first; column < std::min(first + merged, columns); ++column) {
        const Entry& entry = entries[stored(0, row, column)];
        sum.light += entry.light;
        sum.variance += entry.variance;
        sum.known += entry.known;
      }
      result.light[to] = sum.known > 0 ? sum.light / sum.known : 0;
      result.variance[to] =
          sum.known > 0 ? sum.variance / (sum.known * sum.known) : std::numeric_limits<double>::infinity();
    }
  }
  return result;
}

template <class Sample>
void restore_picture(const FramesView<const Sample>& stored, const BlockShares& shares, const Restoration& to,
                     const StoredTable& table, const RestoredPicture<Sample>& result) {
  check(stored, table);
  const std::size_t rows = stored.rows, columns = stored.columns;
  require(table.bounds.size() + 1 == table.light.size(), "bounds", table.bounds.size(), "one less than stored values");
  require(to.rows.size() == rows, "rows", to.rows.size(), "one value a row");
  check(shares, rows, columns);
  const std::size_t down = blocks_of(rows, shares.block_rows), across = blocks_of(columns, shares.block_columns);
  RestoredValues<Sample> values(table, to.max_gain);
  // Copies, which a byte that is written cannot change: their strides stay in registers.
  const FramesView<const Sample> from = stored;
  const RestoredPicture<Sample> into = result;
  std::vector<BetweenBlocks> places;
  for (std::size_t column = 0; column < columns; ++column)
    places.push_back(place_in_blocks(column, shares.block_columns, across));
  const bool is_one = shares.is_one() && table.light.size() <= columns;
  std::vector<Sample> line(columns), all(is_one ? table.light.size() : 0);
  std::iota(all.begin(), all.end(), Sample{0});
  std::vector<Sample> restored(std::max(all.size(), columns));
  std::vector<std::uint8_t> marks(restored.size());
  std::vector<double> of_blocks(across), share(columns, shares.share.front());
  for (std::size_t row = 0; row < rows; ++row) {
    check_interrupt();
    const BetweenBlocks between = place_in_blocks(row, shares.block_rows, down);
    const double* const above = &shares.share[between.before * across];
    const double* const below = &shares.share[between.after * across];
    for (std::size_t k = 0; k < across; ++k) of_blocks[k] = above[k] + between.weight * (below[k] - above[k]);
    for (std::size_t column = 0; !is_one && column < columns; ++column) {
      const BetweenBlocks& at = places[column];
      share[column] = of_blocks[at.before] + at.weight * (of_blocks[at.after] - of_blocks[at.before]);
    }
    for (std::size_t column = 0; column < columns; ++column) line[column] = from(0, row, column);
    const std::span<const Sample> own = is_one ? all : line;
    values.restore(own, {to.rows[row] - 1, to.level - 1, 0}, share, restored.data(), marks.data());
    const auto write = [&](const auto& values_of, const auto& view) {
      for (std::size_t column = 0; column < columns; ++column)
        view(0, row, column) = values_of[is_one ? line[column] : column];
    };
    write(restored, into.picture);
    if (into.marks.data != nullptr) write(marks, into.marks);
    for (std::size_t column = 0; into.share.data != nullptr && column < columns; ++column)
      into.share(0, row, column) = static_cast<float>(share[column]);
  }
}

template Blocks merge_columns(const FramesView<const std::uint8_t>&, std::size_t, const StoredTable&);
template Blocks merge_columns(const FramesView<const std::uint16_t>&, std::size_t, const StoredTable&);
template void restore_picture(const FramesView<const std::uint8_t>&, const BlockShares&, const Restoration&,
                              const StoredTable&, const RestoredPicture<std::uint8_t>&);
template void restore_picture(const FramesView<const std::uint16_t>&, const BlockShares&, const Restoration&,
                              const StoredTable&, const RestoredPicture<std::uint16_t>&);

}  // namespace ocisac
