#include "ocisac/cleaning/restore_picture.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "cleaning/block_shares.hpp"
#include "cleaning/merged_blocks.hpp"
#include "core/check_interrupt.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kCells = 4096;  // of the table from which the search for a stored value starts
constexpr double kMinLeft = 1e-9;     // of the light of a row, as a divisor

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

// A stored value under a gain: that whose neighbourhood contains its light. Where it would burn, rows that were lit
// more do burn: below them is the brightest that is known.
template <class Sample>
class RestoredPixels {
 public:
  RestoredPixels(const StoredTable& table, double max_gain)
      : light_(table.light), bounds_(table.bounds), max_gain_(max_gain), starts_(kCells) {
    bounds_.push_back(std::numeric_limits<double>::quiet_NaN());  // which no light reaches
    for (const double variance : table.variance) is_saturated_.push_back(std::isfinite(variance) ? 0 : 1);
    const auto brightest = static_cast<std::size_t>(std::ranges::find(is_saturated_, 1) - is_saturated_.begin());
    highest_ = brightest - std::min<std::size_t>(brightest, 1);
    const double width = std::max(light_.back() - light_.front(), 1e-300) / static_cast<double>(kCells);
    scale_ = 1 / width;
    for (std::size_t k = 0, value = 0; k < kCells; ++k) {
      while (light_.front() + width * static_cast<double>(k) >= bounds_[value]) ++value;
      starts_[k] = static_cast<std::uint32_t>(value);
    }
  }

  std::pair<Sample, PixelMark> operator()(Sample stored, double gain) const {
    if (is_saturated_[stored] != 0) return {stored, PixelMark::saturated};
    const std::size_t value = value_of(light_[stored] * std::min(gain, max_gain_));
    return {static_cast<Sample>(std::min(value, highest_)), gain > max_gain_ ? PixelMark::dark : PixelMark::restored};
  }

 private:
  std::size_t value_of(double light) const {
    const double place = std::clamp((light - light_.front()) * scale_, 0.0, static_cast<double>(kCells - 1));
    std::size_t value = starts_[static_cast<std::size_t>(place)];
    value += light >= bounds_[value] ? 1 : 0;                 // without a branch: as good as random
    while (value > 0 && light < bounds_[value - 1]) --value;  // rounding of the cell's edge
    while (light >= bounds_[value]) ++value;
    return value;
  }

  std::span<const double> light_;
  std::vector<double> bounds_;  // of each value: below the next one
  double max_gain_, scale_;
  std::vector<std::uint32_t> starts_;
  std::vector<std::uint8_t> is_saturated_;
  std::size_t highest_;
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
  const RestoredPixels<Sample> pixels(table, to.max_gain);
  std::vector<BetweenBlocks> places;
  for (std::size_t column = 0; column < columns; ++column)
    places.push_back(place_in_blocks(column, shares.block_columns, across));
  const bool is_one = shares.is_one() && table.light.size() <= columns;
  const bool has_shares = !is_one || result.share.data != nullptr;
  std::vector<std::pair<Sample, PixelMark>> of_value(is_one ? table.light.size() : 0);
  std::vector<double> line(across), share(columns), of_column(is_one ? 0 : columns);  // shares; gains
  for (std::size_t row = 0; row < rows; ++row) {
    check_interrupt();
    const BetweenBlocks between = place_in_blocks(row, shares.block_rows, down);
    const double* const above = &shares.share[between.before * across];
    const double* const below = &shares.share[between.after * across];
    for (std::size_t k = 0; k < across; ++k) line[k] = above[k] + between.weight * (below[k] - above[k]);
    const double swing = to.rows[row] - 1, rise = to.level - 1;
    const auto gain_of = [&](double own) { return (1 + own * rise) / std::max(1 + own * swing, kMinLeft); };
    for (std::size_t value = 0; value < of_value.size(); ++value)
      of_value[value] = pixels(static_cast<Sample>(value), gain_of(line[0]));
    for (std::size_t column = 0; has_shares && column < columns; ++column) {
      const BetweenBlocks& at = places[column];
      share[column] = line[at.before] + at.weight * (line[at.after] - line[at.before]);
    }
    for (std::size_t column = 0; column < of_column.size(); ++column) of_column[column] = gain_of(share[column]);
    const auto write = [&](const auto& restored_of) {
      for (std::size_t column = 0; column < columns; ++column) {
        const auto [restored, mark] = restored_of(stored(0, row, column), column);
        result.picture(0, row, column) = restored;
        if (result.marks.data != nullptr) result.marks(0, row, column) = static_cast<std::uint8_t>(mark);
      }
    };
    if (is_one)
      write([&](Sample value, std::size_t) { return of_value[value]; });
    else
      write([&](Sample value, std::size_t column) { return pixels(value, of_column[column]); });
    for (std::size_t column = 0; result.share.data != nullptr && column < columns; ++column)
      result.share(0, row, column) = static_cast<float>(share[column]);
  }
}

template Blocks merge_columns(const FramesView<const std::uint8_t>&, std::size_t, const StoredTable&);
template Blocks merge_columns(const FramesView<const std::uint16_t>&, std::size_t, const StoredTable&);
template void restore_picture(const FramesView<const std::uint8_t>&, const BlockShares&, const Restoration&,
                              const StoredTable&, const RestoredPicture<std::uint8_t>&);
template void restore_picture(const FramesView<const std::uint16_t>&, const BlockShares&, const Restoration&,
                              const StoredTable&, const RestoredPicture<std::uint16_t>&);

}  // namespace ocisac
