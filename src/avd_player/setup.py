"""Build and install avd_player; its version stands in package.xml alone."""

from xml.etree import ElementTree as ET

from setuptools import find_packages, setup

PACKAGE = 'avd_player'
MANIFEST = ET.parse('package.xml')

setup(
    name=PACKAGE,
    version=MANIFEST.findtext('version'),
    description=MANIFEST.findtext('description'),
    license='Apache-2.0',
    python_requires='>=3.11',
    packages=find_packages(),
    package_data={PACKAGE: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
    ],
    zip_safe=False,
    entry_points={'console_scripts': ['avd_player_node = avd_player.node:main']},
)
