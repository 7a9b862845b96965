// One JSON object a line, written into memory that is kept from line to line.
#pragma once

#include <concepts>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace ocisac::apps {

// Numbers are the shortest text that reads back as the same; those that are not finite are null.
class JsonLine {
 public:
  JsonLine() { text_.reserve(kReserved); }

  // Begins a new line.
  void begin() {
    text_.clear();
    text_ += '{';
    first_ = true;
  }
  // Ends it; the text stays until the next begin().
  std::string_view end() {
    text_ += "}\n";
    return text_;
  }

  void open(std::string_view name);  // an object within
  void close();

  void member(std::string_view name, double value);
  void member(std::string_view name, bool value);
  void member(std::string_view name, std::string_view value);  // bytes that are no UTF-8 become U+FFFD
  void member(std::string_view name, const char* value) { member(name, std::string_view(value)); }
  void member(std::string_view name, std::integral auto value) { whole(name, static_cast<std::int64_t>(value)); }
  void base64(std::string_view name, std::span<const std::uint8_t> bytes);

  void open_list(std::string_view name);
  void item(std::string_view value);
  void item(std::int64_t value);
  void close_list();

 private:
  static constexpr std::size_t kReserved = 1 << 14;

  void name(std::string_view name);
  void comma();
  void whole(std::string_view name, std::int64_t value);
  void quoted(std::string_view value);

  std::string text_;
  bool first_ = true;
};

}  // namespace ocisac::apps
