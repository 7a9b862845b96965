#include "stream_fit.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <string_view>

namespace ocisac::apps {

namespace {

constexpr std::size_t kFrames = 4;            // compared
constexpr std::size_t kColumnStep = 7;        // every seventh byte of a row: odd and even ones
constexpr double kMuchLess = 0.5;             // a difference that is not by chance below another
constexpr double kAsMuch = 1.25;              // one that is at most by chance above another
constexpr double kNeutral = 128;              // chroma without colour
constexpr double kGrey = 12;                  // largest mean distance from it of the chroma of white light
constexpr int kMaxHighByte = 15;              // of numbers of 12 bits
constexpr double kMinLowByte = 32;            // mean of their low bytes, where a picture is not black
constexpr double kMuchMore = 3;               // distance of luma over that of chroma
constexpr std::size_t kFirstBytes = 1 << 16;  // in which the width is looked for
constexpr std::size_t kMinRowBytes = 40, kMaxRowBytes = 8192, kLagStep = 4;
constexpr std::size_t kAside = 2;  // steps to lags that a peak stands out from
constexpr double kMuchAlike = 3;   // ratio of peaks
constexpr double kByChance = 7;    // over one in root of the number of bytes: five standard deviations of a peak

std::string size_text(const FrameLayout& layout) {
  return std::to_string(layout.width) + "x" + std::to_string(layout.height);
}

// "gray8, nv12 or yuyv"
std::string names_of(const std::vector<PixelFormat>& formats) {
  std::string names;
  for (std::size_t k = 0; k < formats.size(); ++k)
    names += (k == 0 ? "" : k + 1 < formats.size() ? ", " : " or ") + std::string(pixel_format_name(formats[k]));
  return names;
}

// Formats whose dense frames of this width and height satisfy a condition of their size in bytes.
template <class Holds>
std::vector<PixelFormat> formats_where(const FrameLayout& layout, Holds&& holds) {
  std::vector<PixelFormat> formats;
  for (const PixelFormat format : pixel_formats())
    if (holds(dense_bytes(format, layout.width, layout.height))) formats.push_back(format);
  return formats;
}

}  // namespace

std::optional<std::string> length_doubt(std::size_t bytes, const FrameLayout& layout) {
  if (bytes % layout.bytes == 0) return std::nullopt;
  const auto fitting = formats_where(layout, [&](std::size_t size) { return bytes >= size && bytes % size == 0; });
  std::string text = std::to_string(bytes) + " bytes are no whole number of frames of " + size_text(layout) + " in " +
                     std::string(pixel_format_name(layout.format)) + " (" + std::to_string(layout.bytes) +
                     " bytes each): --size or --format may be wrong";
  if (!fitting.empty()) text += "; " + names_of(fitting) + " would fit";
  return text;
}

std::optional<std::string> time_doubt(const Camera& camera, std::size_t rows, std::optional<double> chip_rate) {
  const double most = camera.frame_time.value_or(INFINITY) * (1 + 1e-9);
  const std::string longer = " longer than the frame time, a wrong frame rate or ";
  if (camera.exposure.value_or(0) > most) return "an exposure" + longer + "--exposure (s without a unit)";
  if (chip_rate && 1 / *chip_rate > most) return "a chip" + longer + "--chip-rate (Hz without a unit)";
  if (static_cast<double>(rows) * camera.row_time > most) return "rows" + longer + "--row-time";
  return std::nullopt;
}

std::optional<std::string> FormatCheck::push(std::span<const std::uint8_t> frame) {
  if (frames_ == kFrames || layout_.bytes % layout_.width != 0) return std::nullopt;
  const auto more = frame.first(std::min(frame.size(), kFirstBytes - first_bytes_.size()));
  first_bytes_.insert(first_bytes_.end(), more.begin(), more.end());
  columns_ = (layout_.width + kColumnStep - 1) / kColumnStep;
  for (std::size_t row = 0; row < layout_.bytes / layout_.width; ++row) {
    for (std::size_t column = 0; column < layout_.width; column += kColumnStep)
      samples_.push_back(frame[row * layout_.width + column]);
  }
  if (++frames_ < kFrames) return std::nullopt;
  const std::vector<PixelFormat> other = likely_formats();
  samples_ = {};
  if (other.empty()) {
    const auto row_bytes = other_row_bytes();
    first_bytes_ = {};
    if (!row_bytes) return std::nullopt;
    return "rows are alike at a distance of " + std::to_string(*row_bytes) + " bytes, not of " +
           std::to_string(layout_.stride) + ": --size or --stride may be wrong";
  }
  return "successive frames of " + size_text(layout_) + " in " + std::string(pixel_format_name(layout_.format)) +
         " differ as parts of other frames do: --format " + names_of(other) + " may be meant";
}

// Formats whose frames the stream shows, unless it shows those of the stated one.
std::vector<PixelFormat> FormatCheck::likely_formats() const {
  const std::size_t pixels = layout_.width * layout_.height;
  if (layout_.bytes != 2 * pixels && has_small_high_bytes()) return {PixelFormat::gray10le, PixelFormat::gray12le};
  const std::size_t planar_rows = layout_.height + layout_.height / 2;
  if (2 * layout_.bytes != 3 * pixels && has_grey_chroma(planar_rows)) return {PixelFormat::yuv420p, PixelFormat::nv12};
  const double stated = difference(layout_.bytes / layout_.width);
  return formats_where(layout_, [&](std::size_t size) {
    if (size == layout_.bytes || size % layout_.width != 0 || 2 * size > kFrames * layout_.bytes) return false;
    const double found = difference(size / layout_.width);
    if (2 * size != layout_.bytes) return found < kMuchLess * stated;
    // Whole frames of it are at the stated distance too: halves of a frame are alike, its quarters are not.
    return found <= kAsMuch * stated && found < kMuchLess * difference(size / layout_.width / 2);
  });
}

// True where every second byte is that of numbers of 10 or 12 bits.
bool FormatCheck::has_small_high_bytes() const {
  int largest = 0;
  double low = 0;
  for (std::size_t row = 0; row < rows(); ++row)
    for (std::size_t column = 0; column < columns_; ++column) {
      const int value = samples_[row * columns_ + column];
      if (column % 2 == 0)
        low += value;
      else
        largest = std::max(largest, value);
    }
  return layout_.width % 2 == 0 && largest <= kMaxHighByte &&
         2 * low > kMinLowByte * static_cast<double>(samples_.size());
}

// Mean distance of rows that are `lag` rows apart, each about the means of its even and odd bytes (luma and chroma of
// yuyv): bands of a modulated light, which move from frame to frame, are in the means.
double FormatCheck::difference(std::size_t lag) const {
  std::vector<int> between(columns_);
  double sum = 0;
  for (std::size_t row = 0; row + lag < rows(); ++row) {
    const std::uint8_t* one = &samples_[row * columns_];
    const std::uint8_t* two = &samples_[(row + lag) * columns_];
    std::transform(one, one + columns_, two, between.begin(), std::minus<int>{});
    for (std::size_t parity = 0; parity < std::min<std::size_t>(2, columns_); ++parity) {
      double mean = 0;
      for (std::size_t column = parity; column < columns_; column += 2) mean += between[column];
      mean /= static_cast<double>((columns_ - parity + 1) / 2);
      for (std::size_t column = parity; column < columns_; column += 2) sum += std::abs(between[column] - mean);
    }
  }
  return sum / static_cast<double>((rows() - lag) * columns_);
}

// True where the last third of all frames of `frame_rows` rows is as grey as chroma of white light, and the rest is
// not.
bool FormatCheck::has_grey_chroma(std::size_t frame_rows) const {
  double chroma = 0, luma = 0;
  std::size_t chroma_count = 0, luma_count = 0;
  for (std::size_t row = 0; row < rows() / frame_rows * frame_rows; ++row) {
    const bool in_chroma = 3 * (row % frame_rows) >= 2 * frame_rows;
    double& sum = in_chroma ? chroma : luma;
    for (std::size_t column = 0; column < columns_; ++column)
      sum += std::abs(samples_[row * columns_ + column] - kNeutral);
    (in_chroma ? chroma_count : luma_count) += columns_;
  }
  const double grey = chroma / static_cast<double>(chroma_count);
  return grey < kGrey && luma / static_cast<double>(luma_count) > kMuchMore * grey + 1;
}

// The distance at which steps from byte to byte are alike, whatever the light does from row to row, where it is not
// that of the rows; absent where rows fit, or show no edges.
std::optional<std::size_t> FormatCheck::other_row_bytes() const {
  const std::size_t stated = layout_.stride, count = first_bytes_.size() - 1;
  if (stated >= 2 * layout_.width || count < 2 * stated) return std::nullopt;  // bytes of a pixel differ
  std::vector<std::int32_t> steps(count);
  for (std::size_t k = 0; k < count; ++k) steps[k] = std::abs(first_bytes_[k + 1] - first_bytes_[k]);
  const auto mean = static_cast<std::int32_t>(std::accumulate(steps.begin(), steps.end(), std::int64_t{0}) /
                                              static_cast<std::int64_t>(count));
  for (std::int32_t& step : steps) step -= mean;
  const auto product = [&](std::size_t lag) {
    std::int64_t sum = 0;
    for (std::size_t k = 0; k + lag < count; ++k) sum += std::int64_t{steps[k] * steps[k + lag]};
    return static_cast<double>(sum);
  };
  const auto stands_out = [](double one, double before, double after) { return one - 0.5 * (before + after); };
  std::vector<double> products;
  for (std::size_t lag = 0; lag <= std::min(kMaxRowBytes, count / 2); lag += kLagStep) products.push_back(product(lag));
  const std::size_t near = std::max<std::size_t>(2, stated / 50);  // oblique edges
  double most = 0;
  std::size_t found = 0;
  for (std::size_t k = kMinRowBytes / kLagStep; k + kAside < products.size(); ++k) {
    const std::size_t beyond = k * kLagStep % stated;
    if (std::min(beyond, stated - beyond) <= near) continue;
    const double here = stands_out(products[k], products[k - kAside], products[k + kAside]);
    if (here > most) most = here, found = k * kLagStep;
  }
  constexpr std::size_t aside = kAside * kLagStep;
  const double as_stated =
      stands_out(product(stated), product(std::max(stated, aside) - aside), product(stated + aside));
  const double by_chance = kByChance * products[0] / std::sqrt(static_cast<double>(count));
  return most > std::max(by_chance, kMuchAlike * as_stated) ? std::optional(found) : std::nullopt;
}

}  // namespace ocisac::apps
