"""Build and install vgdp_experiments; its version stands in package.xml alone."""

from xml.etree import ElementTree as ET

from setuptools import find_packages, setup

PACKAGE = 'vgdp_experiments'
MANIFEST = ET.parse('package.xml')

setup(
    name=PACKAGE,
    version=MANIFEST.findtext('version'),
    description=MANIFEST.findtext('description'),
    license='Apache-2.0',
    python_requires='>=3.11',
    packages=find_packages(),
    package_data={
        PACKAGE: ['py.typed', 'maps/*', 'weights/**/*.safetensors', 'weights/**/*.json']
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
    ],
    zip_safe=False,
)
